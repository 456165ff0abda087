// Reads the files named on its input, lines `FORMAT PATH`, and prints what is in them, for
// tests/python/test_io_cpp.py, which compares with what the Python package reads. FORMAT is g2o,
// text or csv, with letters behind a colon: u unit weights, s skip self edges, v vision family,
// r rotations of nodes, w what was read is written anew, p the g2o file with the shortest paths'
// rotations, and the positions that fit them (k: and the positions that it has).

#include <array>
#include <cstdio>
#include <iostream>
#include <sstream>
#include <string>

#include <rotavg/graph/components.hpp>
#include <rotavg/init/shortest_path.hpp>
#include <rotavg/io/g2o.hpp>
#include <rotavg/io/g2o_write.hpp>
#include <rotavg/io/text.hpp>

namespace {

using rotavg::Index;

void print_numbers(const double* numbers, std::size_t count) {
  for (std::size_t k = 0; k < count; ++k) std::printf(" %.17g", numbers[k]);
}

void print(const rotavg::io::GraphFile& file) {
  const rotavg::MeasurementGraph graph = file.graph();
  std::printf("graph %d %d %zu\n", graph.num_nodes(), graph.num_edges(), file.precisions.size());
  for (const rotavg::NodeId node : graph.nodes()) std::printf("%s\n", file.ids.name(node).c_str());
  for (const rotavg::Edge& e : graph.edges()) {
    const rotavg::Vector4 q = rotavg::io::detail::written_quaternion(e.quaternion);
    std::printf("%d %d", e.i, e.j);
    print_numbers(q.data(), 4);
    print_numbers(&e.weight, 1);
    std::printf("\n");
  }
  for (const rotavg::Matrix3& precision : file.precisions) {
    print_numbers(precision.data(), 9);
    std::printf("\n");
  }
}

void print(const rotavg::io::NodeTable<rotavg::FixedRotation>& table) {
  std::printf("rotations %zu\n", table.rows.size());
  for (const rotavg::FixedRotation& row : table.rows) {
    std::printf("%s\n", table.ids.name(row.node).c_str());
    print_numbers(row.world_from_node.data(), 9);
    std::printf("\n");
  }
}

void print_text(const std::string& text) { std::printf("text %zu\n%s", text.size(), text.c_str()); }

void read(const std::string& format, const std::string& letters, const std::string& path) {
  namespace io = rotavg::io;
  const auto has = [&](char letter) { return letters.find(letter) != std::string::npos; };
  io::ReadOptions options;
  options.unit_weights = has('u');
  options.skip_self_edges = has('s');
  options.vision = has('v');
  const bool csv = format == "csv";
  if (format == "g2o") {
    const io::PoseFile file = io::read_g2o(path, options);
    if (has('w')) return print_text(io::to_g2o(file.graph()));
    if (!has('p') && !has('k')) return print(file);
    const rotavg::MeasurementGraph graph = file.graph();
    const rotavg::Components components = rotavg::connected_components(graph);
    const auto which = has('k') ? io::VertexPositions::kept : io::VertexPositions::fitted;
    print_text(io::to_g2o(file, rotavg::shortest_path_init(graph), components, which));
  } else if (has('r')) {
    print(csv ? io::read_csv_rotations(path, options) : io::read_text_rotations(path, options));
  } else {
    const io::GraphFile file = csv ? io::read_csv(path, options) : io::read_text(path, options);
    if (!has('w')) return print(file);
    print_text(csv ? io::to_csv(file.graph(), file.ids) : io::to_text(file.graph(), file.ids));
  }
}

}  // namespace

int main() {
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream words(line);
    std::string format, path;
    words >> format >> std::ws;
    std::getline(words, path);
    const std::size_t colon = format.find(':');
    const std::string letters = colon == std::string::npos ? "" : format.substr(colon + 1);
    try {
      read(format.substr(0, colon), letters, path);
    } catch (const rotavg::io::FormatError& error) {
      std::printf("refused %zu %s\n", error.line(), error.what());
    }
  }
}
