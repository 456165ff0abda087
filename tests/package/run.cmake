# Builds and runs the consumer against this project, reached by `way`.
cmake_minimum_required(VERSION 3.18)

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE status OUTPUT_VARIABLE output
                  ERROR_VARIABLE output)
  if(NOT status EQUAL 0)
    string(REPLACE ";" " " command "${ARGN}")
    message(FATAL_ERROR "failed (${status}): ${command}\n${output}")
  endif()
endfunction()

file(REMOVE_RECURSE "${work}")
if(way STREQUAL "find_package")
  run("${CMAKE_COMMAND}" --install "${project_binary}" --prefix "${work}/prefix")
  # Nothing of the source tree may be left in what is installed.
  file(GLOB_RECURSE installed_cmake "${work}/prefix/*.cmake")
  foreach(file IN LISTS installed_cmake)
    file(READ "${file}" text)
    string(FIND "${text}" "${project_source}" at)
    if(NOT at EQUAL -1)
      message(FATAL_ERROR "${file} names the source tree, ${project_source}")
    endif()
  endforeach()
  set(where -D "CMAKE_PREFIX_PATH=${work}/prefix")
else()
  set(where -D "ROTAVG_SOURCE=${project_source}")
endif()

run("${CMAKE_COMMAND}" -S "${consumer}" -B "${work}/build" -G "${generator}" ${where}
    -D "CMAKE_CXX_COMPILER=${cxx}" -D "CMAKE_CXX_FLAGS=${cxx_flags}")
run("${CMAKE_COMMAND}" --build "${work}/build")
run("${work}/build/consumer")
if(way STREQUAL "find_package")
  run("${work}/build/consumer_compiled")
endif()
