// Reads a pose graph, solves it, certifies the answer, and writes it back: pose_graph IN.g2o
// OUT.g2o

#include <cstdio>
#include <stdexcept>
#include <string>

#include <rotavg/io/g2o.hpp>
#include <rotavg/io/g2o_write.hpp>
#include <rotavg/rotavg.hpp>

int main(int count, char** words) {
  if (count != 3) {
    std::fprintf(stderr, "usage: pose_graph IN.g2o OUT.g2o\n");
    return 2;
  }
  try {
    const rotavg::io::PoseFile file = rotavg::io::read_g2o(words[1]);
    for (const std::string& note : file.notes) std::printf("%s: %s\n", words[1], note.c_str());

    const rotavg::MeasurementGraph graph = file.graph();
    const rotavg::Solution solution = rotavg::solve(graph);
    const bool proved = solution.certificate.verdict == rotavg::Verdict::proved;
    std::printf("%d nodes, %d edges, objective %.9g, %s\n", graph.num_nodes(), graph.num_edges(),
                solution.objective, proved ? "proved globally optimal" : "not proved");

    rotavg::io::write_file(words[2],
                           rotavg::io::to_g2o(file, solution.rotations, solution.components));
    return proved ? 0 : 1;
  } catch (const std::invalid_argument& error) {  // a FormatError names the file and the line
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
