#include <cstring>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "gil.hpp"
#include "read_lines.hpp"
#include "write_lines.hpp"

namespace rotavg_python {
namespace {

namespace py = pybind11;

using Parts = std::vector<Part>;
template <typename T>
using Array = py::array_t<T, py::array::c_style | py::array::forcecast>;

py::ssize_t count_of(const std::string& columns, char column) {
  return std::count(columns.begin(), columns.end(), column);
}

/// What all parts hold of one kind, in one array.
template <typename T>
py::array_t<T> joined(Parts& parts, std::size_t kind, std::vector<T> Rows::* member,
                      std::vector<py::ssize_t> shape) {
  py::array_t<T> result(std::move(shape));
  T* to = result.mutable_data();
  const WithoutGil release;
  for (Part& part : parts) {
    std::vector<T>& values = part.rows[kind].*member;
    to = std::copy(values.begin(), values.end(), to);
    std::vector<T>().swap(values);
  }
  return result;
}

/// The names as an array of bytes of a fixed width; None where all of them are integers, which are
/// too large then to be taken for such, or one is very long.
py::object joined_names(const char* text, Parts& parts, std::size_t kind, py::ssize_t rows,
                        py::ssize_t columns) {
  constexpr std::int64_t very_long = 256;
  std::int64_t width = 1;
  bool integers = true;
  for (const Part& part : parts) {
    for (const Place& name : part.rows[kind].names) {
      const char* const begin = text + name.begin;
      integers = integers && rotavg::io::is_plain_integer(begin, begin + name.size);
      width = std::max(width, name.size);
    }
  }
  if (integers || width > very_long) return py::none();
  py::array result(py::dtype("S" + std::to_string(width)), std::vector<py::ssize_t>{rows, columns});
  char* to = static_cast<char*>(result.mutable_data());
  std::memset(to, 0, static_cast<std::size_t>(result.nbytes()));
  for (const Part& part : parts) {
    for (const Place& name : part.rows[kind].names) {
      std::memcpy(to, text + name.begin, static_cast<std::size_t>(name.size));
      to += width;
    }
  }
  return result;
}

py::object table_of(const char* text, Parts& parts, std::size_t kind, const std::string& columns) {
  py::ssize_t rows = 0;
  for (const Part& part : parts) rows += static_cast<py::ssize_t>(part.rows[kind].lines.size());
  py::object ids;
  if (count_of(columns, 's') > 0) {
    ids = joined_names(text, parts, kind, rows, count_of(columns, 's'));
    if (ids.is_none()) return ids;
  } else {
    ids = joined(parts, kind, &Rows::integers, {rows, count_of(columns, 'i')});
  }
  return py::make_tuple(ids, joined(parts, kind, &Rows::numbers, {rows, count_of(columns, 'n')}),
                        joined(parts, kind, &Rows::lines, {rows}));
}

py::object read(const py::bytes& data, std::int64_t first, std::int64_t skip, char separator,
                const std::vector<std::pair<std::string, std::string>>& kinds, int num_threads) {
  char* text = nullptr;
  py::ssize_t size = 0;
  if (PyBytes_AsStringAndSize(data.ptr(), &text, &size) != 0) throw py::error_already_set();
  std::vector<Kind> wanted;
  for (const auto& [tag, columns] : kinds) wanted.push_back({tag, columns});
  const int threads = rotavg::resolve_num_threads(num_threads);
  Parts parts;
  {
    const WithoutGil release;
    parts = read_lines(text + skip, text + size, first, separator, wanted, threads);
  }
  if (parts.empty()) return py::none();
  py::list tables;
  for (std::size_t kind = 0; kind < wanted.size(); ++kind) {
    py::object table = table_of(text + skip, parts, kind, wanted[kind].columns);
    if (table.is_none()) return table;
    tables.append(std::move(table));
  }
  py::list others;
  for (const Part& part : parts) {
    for (const auto& [line, begin, end] : part.others) {
      others.append(py::make_tuple(
          line, py::bytes(text + skip + begin, static_cast<std::size_t>(end - begin))));
    }
  }
  return py::make_tuple(tables, others);
}

py::bytes write(const Array<std::int64_t>& integers, const Array<double>& numbers,
                const std::string& tag, char separator, bool short_zeros, const std::string& tail,
                int num_threads) {
  if (integers.ndim() != 2 || numbers.ndim() != 2 || integers.shape(0) != numbers.shape(0)) {
    throw std::invalid_argument("integers (m, k) and numbers (m, l) do not match");
  }
  Output table;
  table.tag = tag;
  table.separator = separator;
  table.short_zeros = short_zeros;
  table.tail = tail;
  table.integers = integers.data();
  table.num_integers = static_cast<std::size_t>(integers.shape(1));
  table.numbers = numbers.data();
  table.num_numbers = static_cast<std::size_t>(numbers.shape(1));
  const auto rows = static_cast<std::size_t>(numbers.shape(0));
  const int threads = rotavg::resolve_num_threads(num_threads);
  std::vector<std::string> parts;
  std::size_t size = 0;
  {
    const WithoutGil release;
    parts = write_lines(table, rows, threads);
    for (const std::string& part : parts) size += part.size();
  }
  py::bytes result(nullptr, size);  // to be filled
  char* to = PyBytes_AS_STRING(result.ptr());
  const WithoutGil release;
  for (std::string& part : parts) {
    to = std::copy(part.begin(), part.end(), to);
    std::string().swap(part);
  }
  return result;
}

}  // namespace
}  // namespace rotavg_python

PYBIND11_MODULE(_text, m) {
  namespace py = pybind11;
  m.doc() = "Long texts at speed, for the readers and writers in rotavg/io.";
#ifdef __cpp_lib_to_chars
  m.attr("knows_numbers") = true;
#else
  m.attr("knows_numbers") = false;
#endif
  m.def("read", &rotavg_python::read, py::arg("data"), py::arg("first"), py::arg("skip"),
        py::arg("separator"), py::arg("kinds"), py::arg("num_threads") = 0);
  m.def("write", &rotavg_python::write, py::arg("integers"), py::arg("numbers"), py::arg("tag"),
        py::arg("separator"), py::arg("short_zeros"), py::arg("tail"), py::arg("num_threads") = 0);
}
