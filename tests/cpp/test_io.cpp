#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/io/g2o.hpp>
#include <rotavg/io/g2o_write.hpp>
#include <rotavg/io/node_ids.hpp>
#include <rotavg/io/numbers.hpp>
#include <rotavg/io/source.hpp>
#include <rotavg/io/text.hpp>
#include <rotavg/poses/positions.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/so3/lie.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

/// What reading says of a text; "" if it is read.
template <typename Read>
std::string refusal(const std::string& text, Read&& read) {
  std::istringstream stream(text);
  try {
    read(io::Source(stream, "f"));
  } catch (const io::FormatError& error) {
    CHECK(std::string(error.what()).rfind("f:", 0) == 0);
    return error.what();
  }
  return "";
}

io::GraphFile text_of(const std::string& text, const io::ReadOptions& options = {}) {
  std::istringstream stream(text);
  return io::read_text(stream, options);
}

io::PoseFile g2o_of(const std::string& text, const io::ReadOptions& options = {}) {
  std::istringstream stream(text);
  return io::read_g2o(stream, options);
}

/// Edges, weights and rotations of what was written and read again, but for a rounding.
void check_same(const MeasurementGraph& a, const MeasurementGraph& b) {
  REQUIRE(a.nodes() == b.nodes());
  REQUIRE(a.num_edges() == b.num_edges());
  for (Index k = 0; k < a.num_edges(); ++k) {
    const Edge e = a.edges()[static_cast<std::size_t>(k)];
    const Edge f = b.edges()[static_cast<std::size_t>(k)];
    CHECK(e.i == f.i);
    CHECK(e.j == f.j);
    CHECK(std::abs(e.weight / f.weight - 1.0) < 1e-15);
    CHECK((e.i_from_j() - f.i_from_j()).norm() < 1e-15);
  }
}

const std::string ring =
    "VERTEX_SE3:QUAT 3 1 2 3 0 0 0.6 0.8 # here\r\n"
    "EDGE_SE3:QUAT 3 5 1 0 0 0 0 0.1 1 4 0 0 0 0 0 4 0 0 0 0 4 0 0 0 2 0 0 2 0 2\r\n"
    "OTHER 1 2\r\n"
    "EDGE_SE3:QUAT 5 8 1 0 0 0 0 0.1 1 4 0 0 0 0 0 4 0 0 0 0 4 0 0 0 2 0 0 2 0 2\r\n"
    "FIX 3\r\n"
    "EDGE_SE3:QUAT 8 3 1 0 0 0 0.1 0 1 4 0 0 0 0 0 4 0 0 0 0 4 0 0 0 2 0.5 0 3 0 4\r\n";

}  // namespace

TEST_CASE("a graph comes back from every format as it was") {
  Random random;
  INFO(random.replay());
  auto measurements = test::simulate(random, test::random_connected(random, 30, 40), 0.3);
  test::spread_weights(random, 6.0, measurements);
  for (RelativeRotation& m : measurements) m.i -= 7, m.j -= 7;
  const MeasurementGraph graph(measurements);
  check_same(graph, text_of(io::to_text(graph)).graph());
  check_same(graph, text_of(io::to_csv(graph)).graph());
  check_same(graph, g2o_of(io::to_g2o(graph)).graph());
}

TEST_CASE("names come back, in rising order, and CSV holds any") {
  io::NodeIds ids;
  const MeasurementGraph graph(
      {{ids.add("left, up"), ids.add("a \"b\""), exp_so3({0, 0, 0.5})},
       {ids.add("a \"b\""), ids.add("\xc3\xa9"), exp_so3({0, 1, 0}), 2.0}});
  std::istringstream stream(io::to_csv(graph, ids));
  const io::GraphFile file = io::read_csv(stream);
  REQUIRE(file.ids.size() == 3);
  CHECK(file.ids.name(0) == "a \"b\"");
  CHECK(file.ids.name(1) == "left, up");
  CHECK(file.ids.name(2) == "\xc3\xa9");
  CHECK(file.measurements[0].i == 1);
  CHECK(file.measurements[0].j == 0);
  CHECK(file.measurements[1].weight == 2.0);
  CHECK(file.ids.find("left, up") == 1);
  CHECK_FALSE(file.ids.find("right").has_value());
  CHECK_THROWS_AS(file.ids.name(3), std::out_of_range);
  CHECK_THROWS_AS(io::to_text(graph, ids), std::invalid_argument);
  io::NodeIds divided;
  const MeasurementGraph pair({{divided.add("a"), divided.add("b;c")}});
  CHECK_THROWS_AS(io::to_text(pair, divided), std::invalid_argument);
  std::istringstream quoted(io::to_csv(pair, divided));
  CHECK(io::read_csv(quoted).ids.find("b;c").has_value());
  CHECK(io::NodeIds().find("-12") == -12);
  CHECK_FALSE(io::NodeIds().find("012").has_value());
  CHECK(io::NodeIds().name(5) == "5");
}

TEST_CASE("a pose graph: weights, vertices, what is fixed, and what is told") {
  const io::PoseFile file = g2o_of(ring);
  REQUIRE(file.measurements.size() == 3);
  CHECK(file.dimension == 3);
  CHECK(file.nodes == std::vector<NodeId>{3, 5, 8});
  // kappa = 3 / (2 tr(Omega^-1)): of 2 I it is 1.
  CHECK(file.measurements[0].weight == doctest::Approx(1.0).epsilon(1e-15));
  Matrix3 omega;
  omega << 2, 0.5, 0, 0.5, 3, 0, 0, 0, 4;
  const double trace = 3.0 / 5.75 + 2.0 / 5.75 + 0.25;  // of its inverse
  CHECK(file.measurements[2].weight == doctest::Approx(1.5 / trace).epsilon(1e-14));
  REQUIRE(file.precisions.size() == 3);
  CHECK(file.precisions[2] == omega);
  CHECK(file.translations[1] == Vector3(1, 0, 0));
  REQUIRE(file.translation_information.size() == 3);
  CHECK(file.translation_information[1] == 4.0 * Matrix3::Identity());
  REQUIRE(file.vertices.size() == 1);
  CHECK(file.vertices[0].position == Vector3(1, 2, 3));
  REQUIRE(file.fixed.size() == 1);
  CHECK(file.fixed[0].node == 3);
  CHECK((file.fixed[0].world_from_node - exp_so3({0, 0, 2.0 * std::atan2(0.6, 0.8)})).norm() <
        1e-15);
  REQUIRE(file.notes.size() == 2);
  CHECK(file.notes[0] == "1 line with unknown tags skipped (OTHER: 1)");
  CHECK(
      file.notes[1] ==
      "3 quaternions normalised whose length was not 1 (off by up to 0.00498756, first in line 2)");
  io::ReadOptions options;
  options.unit_weights = true;
  CHECK(g2o_of(ring, options).measurements[2].weight == 1.0);
}

TEST_CASE("what a pose graph says of translations") {
  // Rows of the upper triangle: x y z, and three columns about the rotation.
  const io::PoseFile space = g2o_of(
      "EDGE_SE3:QUAT 1 2 1 0 0 0 0 0 1 10 1 2 .1 .1 .1 20 3 .1 .1 .1 30 .1 .1 .1 2 0 0 2 0 2\n");
  Matrix3 expected;
  expected << 10, 1, 2, 1, 20, 3, 2, 3, 30;
  REQUIRE(space.translation_information.size() == 1);
  CHECK(space.translation_information[0] == expected);
  const io::PoseFile plane = g2o_of("EDGE_SE2 1 2 1 0 0.5 10 1 2 30 3 7\n");
  expected << 10, 1, 0, 1, 30, 0, 0, 0, 20;
  CHECK(plane.translation_information[0] == expected);
  CHECK(g2o_of("EDGE_SE2 1 2 0 0 0.5 10 1 2 30 3 7\n").translation_information.empty());
  const io::PoseFile bad =
      g2o_of("EDGE_SE2 1 2 1 0 0.5 1 0 0 1 0 7\nEDGE_SE2 2 3 1 0 0.5 1 2 0 1 0 7\n");
  CHECK(bad.translations.empty());
  CHECK(bad.translation_information.empty());
  REQUIRE(bad.notes.size() == 1);
  CHECK(bad.notes[0] ==
        "translations not used: the information about them is not positive definite (edge 1)");
  io::ReadOptions options;
  options.unit_weights = true;
  const io::PoseFile bare = g2o_of("EDGE_SE2 1 2 1 0 0.5\n", options);
  CHECK(bare.translations.size() == 1);
  CHECK(bare.translation_information.empty());
}

TEST_CASE("a solution goes back into its pose graph; all other bytes stay") {
  const io::PoseFile file = g2o_of(ring);
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = file.graph();
  const Rotations R = random.rotations(3);
  const Components components = connected_components(graph);
  const std::string text = io::to_g2o(file, R, components);
  CHECK(text.substr(0, text.find('\n') + 1) == ring.substr(0, ring.find('\n') + 1));  // fixed
  CHECK(text.substr(text.find("EDGE_SE3:QUAT 3")) == ring.substr(ring.find("EDGE_SE3:QUAT 3")));
  const io::PoseFile back = g2o_of(text);
  REQUIRE(back.vertices.size() == 3);
  Rotations written;
  for (const io::Vertex& vertex : back.vertices) written.push_back(vertex.world_from_node);
  CHECK(written[0] == file.fixed[0].world_from_node);
  CHECK(objective(graph, written) == doctest::Approx(objective(graph, R)).epsilon(1e-13));

  // Positions fit the rotations that are written, and no others.
  const std::vector<Vector3> fitted =
      positions(graph, written, file.translations, file.translation_information,
                {{3, file.vertices[0].position}});
  for (std::size_t k = 0; k < 3; ++k) {
    CHECK((back.vertices[k].position - fitted[k]).norm() < 1e-12);
  }
  // What a robust loss has left of an edge counts: here nothing, and the others are met.
  const io::PoseFile without =
      g2o_of(io::to_g2o(file, R, components, io::VertexPositions::fitted, {1.0, 1.0, 1e-12}));
  for (std::size_t k = 0; k < 2; ++k) {
    const Edge& e = graph.edges()[k];
    const auto at = [&](Index i) { return without.vertices[static_cast<std::size_t>(i)].position; };
    const Matrix3& R_i = written[static_cast<std::size_t>(e.i)];
    CHECK((R_i.transpose() * (at(e.j) - at(e.i)) - file.translations[k]).norm() < 1e-9);
  }
  const io::PoseFile kept = g2o_of(io::to_g2o(file, R, components, io::VertexPositions::kept));
  CHECK(kept.vertices[2].position == Vector3::Zero());

  // Those of one's own turn and move with the rotations: distances and directions stay.
  const std::vector<Vector3> own{{9, 9, 9}, {4, 0, 0}, {0, 5, 0}};
  const io::PoseFile moved = g2o_of(io::to_g2o(file, R, components, own));
  CHECK(moved.vertices[0].position == Vector3(1, 2, 3));
  for (std::size_t k = 0; k < 3; ++k) {
    const Vector3 before = R[0].transpose() * (own[k] - own[0]);
    const Vector3 after = written[0].transpose() * (moved.vertices[k].position - Vector3(1, 2, 3));
    CHECK((before - after).norm() < 1e-12);
  }
  CHECK_THROWS_AS(io::to_g2o(file, R, components, std::vector<Vector3>(2)), std::invalid_argument);
  CHECK_THROWS_AS(io::to_g2o(file, R, components, io::VertexPositions::fitted, {1.0}),
                  std::invalid_argument);
  CHECK_THROWS_AS(io::to_g2o(file, Rotations(2, Matrix3::Identity()), components),
                  std::invalid_argument);
}

TEST_CASE("priors of a graph's nodes, by their names") {
  const io::GraphFile file = text_of("a b 0 0 0 1\nb c 0 0 0.6 0.8\n");
  std::istringstream known("# id qx qy qz qw\nc 0 0 0.6 0.8\nx 0 0 0 1\na 1 0 0 0\n");
  const auto rotations = io::of_graph(io::read_text_rotations(known), file);
  REQUIRE(rotations.size() == 2);
  CHECK(file.ids.name(rotations[0].node) == "c");
  CHECK((rotations[1].world_from_node - exp_so3({3.141592653589793, 0, 0})).norm() < 1e-15);
  std::istringstream down("b 0 2 0\nz 1 0 0\n");
  const auto gravity = io::of_graph(io::read_gravity(down, 5.0), file);
  REQUIRE(gravity.size() == 1);
  CHECK(file.ids.name(gravity[0].node) == "b");
  CHECK(gravity[0].down == Vector3(0, 2, 0));
  CHECK(gravity[0].weight == 5.0);
  CHECK(io::to_gravity_text(gravity, file.ids) == "b 0.0 2.0 0.0\n");
}

TEST_CASE("the vision family is transposed, covariances with it") {
  const std::string text = "i j qx qy qz qw cxx cxy cxz cyy cyz czz\n1 2 0 0 0.6 0.8 1 0 0 2 0 4\n";
  io::ReadOptions options;
  options.vision = true;
  const io::GraphFile pose = text_of(text), vision = text_of(text, options);
  const Matrix3 R = pose.measurements[0].i_from_j.normalized().toRotationMatrix();
  const Matrix3 T = vision.measurements[0].i_from_j.normalized().toRotationMatrix();
  CHECK((R - T.transpose()).norm() < 1e-15);
  CHECK((vision.precisions[0] - T.transpose() * pose.precisions[0] * T).norm() < 1e-15);
  CHECK(pose.measurements[0].weight == doctest::Approx(3.0 / 7.0).epsilon(1e-15));
}

TEST_CASE("what is wrong is told with the line, what was found and what was expected") {
  const auto g2o = [](const std::string& text) {
    return refusal(text, [](const io::Source& source) { io::read_g2o(source); });
  };
  const auto text = [](const std::string& content) {
    return refusal(content, [](const io::Source& source) { io::read_text(source); });
  };
  CHECK(g2o("\nEDGE_SE2 1 x 0 0 0 1 0 0 1 0 1\n") ==
        "f:2: found '1' 'x' for node ids, expected integers");
  CHECK(g2o("VERTEX_SE2 1 0 0 0\n") ==
        "f: the file has no edges: no line EDGE_SE3:QUAT, EDGE_SE2; found VERTEX_SE2: 1");
  CHECK(g2o("EDGE_SE2 1 2 0 0 0 1 0 0 1 0 1 5\n") ==
        "f:1: found 10 numbers after the ids, expected 9");
  CHECK(g2o("EDGE_SE2 4 4 0 0 0 1 0 0 1 0 1\n") ==
        "f:1: edge 0 (4 -> 4): it joins a node to itself; expected two different nodes");
  CHECK(text("a b 0 0 0 1\na c 0 0 1\n") == "f:2: found 3 numbers after the ids, expected 4");
  CHECK(text("a b 0 0 5 1\n") ==
        "f:1: found a quaternion of length 5.09902, expected length 1 "
        "(are the columns in another order?)");
  CHECK(text("a b 0 0 0 1 -1\n") ==
        "f:1: edge 0 ('a' -> 'b'): found the weight -1; expected a "
        "number between 1e-100 and 1e+100");
  CHECK(text("") == "f: the file is empty, expected a measurement graph");
  CHECK_THROWS_WITH_AS(io::read_g2o("no/such/file"),
                       "no/such/file: cannot be read: No such file or directory", io::FormatError);
  CHECK_THROWS_AS(io::read_g2o("."), io::FormatError);
}

TEST_CASE("numbers are read and written whatever their size") {
  const std::vector<std::pair<std::string, double>> cases = {
      {"1e-320", 1e-320},  {"1e-999", 0.0},       {"-0", 0.0},
      {"+.5", 0.5},        {"5.", 5.0},           {"1E3", 1000.0},
      {"1e999", INFINITY}, {"-1e999", -INFINITY}, {"Infinity", INFINITY}};
  for (const auto& [word, expected] : cases) {
    double value = 1.0;
    CAPTURE(word);
    CHECK(io::read_any_number(word, value));
    CHECK(value == expected);
  }
  for (const char* word : {"", "+", "-", ".", "1e", "0x10", "1_0", "1,5", "nan(1)", "1.2.3", "--1",
                           "e5", "1e+", "+-1"}) {
    double value = 0.0;
    CAPTURE(word);
    CHECK_FALSE(io::read_any_number(word, value));
  }
  Random random;
  INFO(random.replay());
  for (int k = 0; k < 1000; ++k) {
    const double value = random.normal() * random.power_of_ten(-300, 300);
    std::string text;
    io::append_number(text, value);
    double back = 0.0;
    CHECK(io::read_any_number(text, back));
    CHECK(back == value);
  }
}

TEST_CASE("a file is written whole or not at all") {
  const std::string path = "rotavg_test_io.txt";
  io::write_file(path, "one");
  CHECK(io::Source(path).content() == "one");
  io::write_file(path, "two");
  CHECK(io::Source(path).content() == "two");
  CHECK_FALSE(std::ifstream(path + ".new").good());
  std::remove(path.c_str());
  CHECK_THROWS_AS(io::write_file("no/such/folder/file", ""), io::FormatError);
  CHECK_THROWS_AS(io::write_file("/dev/full", std::string(100000, 'x')), io::FormatError);
}
