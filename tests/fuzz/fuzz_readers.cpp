// Coverage-guided fuzzing of the readers in rotavg/io, by libFuzzer. The first byte says which
// reader, and how; the rest is the file. What is read must make a graph, and come back from what is
// written of it; what is refused must be refused by a FormatError.

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <stdexcept>
#include <string>

#include <rotavg/graph/components.hpp>
#include <rotavg/io/g2o.hpp>
#include <rotavg/io/g2o_write.hpp>
#include <rotavg/io/text.hpp>

namespace {

namespace io = rotavg::io;

void expect(bool holds) {
  if (!holds) std::abort();
}

template <typename Read>
io::GraphFile again(const std::string& text, const Read& read) {
  std::istringstream stream(text);
  return read(io::Source(stream), io::ReadOptions{});
}

/// @param ids_stay of text, where names that look like integers become such
void compare(const io::GraphFile& file, const io::GraphFile& back, bool ids_stay) {
  expect(back.measurements.size() == file.measurements.size());
  for (std::size_t k = 0; k < back.measurements.size(); ++k) {
    const rotavg::RelativeQuaternion &a = file.measurements[k], &b = back.measurements[k];
    expect(std::abs(a.weight / b.weight - 1.0) < 1e-14);
    if (ids_stay) expect(file.ids.name(a.i) == back.ids.name(b.i));
    const auto p = io::detail::written_quaternion(a.i_from_j);
    const auto q = io::detail::written_quaternion(b.i_from_j);
    expect(std::min((p - q).norm(), (p + q).norm()) < 1e-14);
  }
}

void read_pose_graph(const io::Source& source, const io::ReadOptions& options) {
  const io::PoseFile file = io::read_g2o(source, options);
  const rotavg::MeasurementGraph graph = file.graph();
  compare(file, again(io::to_g2o(graph), io::read_g2o), true);
  const rotavg::Rotations R(file.nodes.size(), rotavg::exp_so3({0.1, 0.2, 0.3}));
  const rotavg::Components components = rotavg::connected_components(graph);
  std::string text = io::to_g2o(file, R, components, io::VertexPositions::kept);
  try {
    text = io::to_g2o(file, R, components);
  } catch (const std::invalid_argument&) {  // numbers that are too large, or too far apart
  }
  std::istringstream stream(text);
  io::ReadOptions lenient = options;
  lenient.unit_weights = lenient.skip_self_edges = true;
  const io::PoseFile back = io::read_g2o(stream, lenient);
  expect(back.nodes == file.nodes && back.vertices.size() == file.nodes.size());
}

void read_table(const io::Source& source, const io::ReadOptions& options, bool csv) {
  const io::GraphFile file = csv ? io::read_csv(source, options) : io::read_text(source, options);
  const rotavg::MeasurementGraph graph = file.graph();
  try {
    if (csv) {
      compare(file, again(io::to_csv(graph, file.ids), io::read_csv), true);
    } else {
      compare(file, again(io::to_text(graph, file.ids), io::read_text), true);
    }
  } catch (const io::FormatError&) {
    std::abort();                           // what was written must be read
  } catch (const std::invalid_argument&) {  // a name that text cannot hold
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  std::istringstream stream(std::string(data + 1, data + size));
  const unsigned how = data[0];
  io::ReadOptions options;
  options.unit_weights = (how & 8U) != 0;
  options.skip_self_edges = (how & 16U) != 0;
  options.vision = (how & 32U) != 0;
  if ((how & 192U) == 192U) options.columns = "i,j,qw,qx,qy,qz,weight";
  try {
    const io::Source source(stream);
    switch (how & 7U) {
      case 0:
      case 1:
        read_pose_graph(source, options);
        break;
      case 2:
      case 3:
        read_table(source, options, false);
        break;
      case 4:
      case 5:
        read_table(source, options, true);
        break;
      case 6:
        options.columns.clear();
        for (const auto& row : io::read_csv_rotations(source, options).rows) {
          expect(rotavg::orthogonality_error(row.world_from_node) < 1e-12);
        }
        break;
      default:
        io::read_gravity(source);
    }
  } catch (const io::FormatError&) {
  }
  return 0;
}
