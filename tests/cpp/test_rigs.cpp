#include <algorithm>
#include <cstddef>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/init/rig_start.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/reduction/grounded_graph.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/robust/solve_rigs.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/solve/shared_rotations.hpp>
#include <rotavg/solve/solve_with_priors.hpp>

#include "support/random.hpp"

using namespace rotavg;

namespace {

/// A rig of some cameras in some frames: node 10 f + s is sensor s in frame f.
struct Scene {
  Rotations frames, sensors;
  Rigs rigs;
  std::vector<RelativeRotation> edges;

  Matrix3 truth(NodeId node) const { return frames[node / 10] * sensors[node % 10]; }
};

Matrix3 random_turn(test::Random& random, double angle) {
  return exp_so3(angle * Vector3(random.normal(), random.normal(), random.normal()));
}

/// @param joined whether two sensors see each other
template <typename Joined>
Scene make_scene(test::Random& random, int num_frames, int num_sensors, double noise,
                 Joined&& joined) {
  Scene scene;
  for (int f = 0; f < num_frames; ++f) scene.frames.push_back(random_turn(random, 1.0));
  for (int s = 0; s < num_sensors; ++s) {
    scene.sensors.push_back(s == 0 ? Matrix3(Matrix3::Identity()) : random_turn(random, 0.5));
  }
  for (int f = 0; f < num_frames; ++f) {
    for (int s = 0; s < num_sensors; ++s) {
      scene.rigs.images.push_back({10 * f + s, 100 + f, 7 + s});
      for (int g = f + 1; g < num_frames; ++g) {
        for (int t = 0; t < num_sensors; ++t) {
          if (!joined(s, t)) continue;
          const NodeId i = 10 * f + s, j = 10 * g + t;
          const Matrix3 R = scene.truth(i).transpose() * scene.truth(j);
          scene.edges.push_back({i, j, R * random_turn(random, noise), 1.0 + (s + t) % 2});
        }
      }
    }
  }
  return scene;
}

bool all_see_all(int, int) { return true; }

double largest_error(const RigEstimate& estimate, const Scene& scene) {
  double error = 0.0;
  for (std::size_t s = 0; s < estimate.sensors.size(); ++s) {
    error = std::max(error, angle_between(estimate.frame_from_sensor[s],
                                          scene.sensors[estimate.sensors[s] - 7]));
  }
  return error;
}

double objective_of(const MeasurementGraph& graph, const Scene& scene, const Rotations& C,
                    const std::vector<NodeId>& sensors, const SolveOptions& options) {
  RigEstimate held;
  held.sensors = sensors;
  held.frame_from_sensor = C;
  return solve(graph, held.held(graph, scene.rigs), options).objective;
}

}  // namespace

TEST_CASE("sensors without noise are found to rounding, and proved with the frames") {
  test::Random random;
  INFO(random.replay());
  const Scene scene = make_scene(random, 6, 3, 0.0, all_see_all);
  const MeasurementGraph graph(scene.edges);
  const RigSolution solution = solve_rigs(graph, scene.rigs);
  CHECK(largest_error(solution.rigs, scene) < 1e-12);
  CHECK(solution.rigs.origin[0] == SensorOrigin::reference);
  CHECK(solution.rigs.origin[1] == SensorOrigin::estimated);
  CHECK(solution.rigs.converged);
  CHECK(solution.certificate.verdict == Verdict::proved);
  REQUIRE(solution.rigs.lower_bound.has_value());
  CHECK(solution.objective < 1e-24);
}

TEST_CASE("with noise no sensor can be turned to advantage, and images alone bound it from below") {
  test::Random random;
  INFO(random.replay());
  const Scene scene = make_scene(random, 7, 3, 0.05, all_see_all);
  const MeasurementGraph graph(scene.edges);
  const RigSolution solution = solve_rigs(graph, scene.rigs);
  CHECK(solution.rigs.converged);
  CHECK(solution.rigs.relative_gradient <= 1e-9);
  CHECK(solution.rigs.determined[1]);
  REQUIRE(solution.rigs.lower_bound.has_value());
  CHECK(*solution.rigs.lower_bound < solution.objective);
  CHECK(*solution.rigs.lower_bound > 0.5 * solution.objective);
  SolveOptions options;
  options.certify = false;
  for (int k = 0; k < 12; ++k) {
    Rotations C = solution.rigs.frame_from_sensor;
    const std::size_t s = 1 + static_cast<std::size_t>(k % 2);
    C[s] = exp_so3(1e-3 * Vector3::Unit((k / 2) % 3) * (k < 6 ? 1.0 : -1.0)) * C[s];
    CHECK(objective_of(graph, scene, C, solution.rigs.sensors, options) > solution.objective);
  }
}

TEST_CASE("known sensors stay as they are, and hold the others") {
  test::Random random;
  INFO(random.replay());
  Scene scene = make_scene(random, 5, 3, 0.02, all_see_all);
  const Matrix3 given = random_turn(random, 1.0);
  scene.rigs.known = {{8, given}};  // sensor 1; the frames turn with it
  const MeasurementGraph graph(scene.edges);
  const RigSolution solution = solve_rigs(graph, scene.rigs);
  CHECK(solution.rigs.origin == std::vector<SensorOrigin>{SensorOrigin::estimated,
                                                          SensorOrigin::known,
                                                          SensorOrigin::estimated});
  CHECK(angle_between(solution.rigs.frame_from_sensor[1], given) < 1e-14);
  const Matrix3 turn = given * scene.sensors[1].transpose();
  CHECK(angle_between(solution.rigs.frame_from_sensor[0], turn) < 0.05);
  CHECK(angle_between(solution.rigs.frame_from_sensor[2], turn * scene.sensors[2]) < 0.05);
}

TEST_CASE("sensors that never see the same are found from how both turn") {
  test::Random random;
  INFO(random.replay());
  const Scene scene = make_scene(random, 8, 2, 0.0, [](int s, int t) { return s == t; });
  const MeasurementGraph graph(scene.edges);
  const RigSolution solution = solve_rigs(graph, scene.rigs);
  CHECK(largest_error(solution.rigs, scene) < 1e-9);
  CHECK(solution.rigs.determined[1]);
}

TEST_CASE("turning about one axis does not tell a sensor that sees nothing of the others") {
  test::Random random;
  INFO(random.replay());
  Scene scene = make_scene(random, 6, 2, 0.0, [](int s, int t) { return s == t; });
  scene.edges.clear();
  for (int f = 0; f < 6; ++f) scene.frames[f] = exp_so3(0.3 * f * Vector3::UnitY());
  for (NodeId s = 0; s < 2; ++s) {
    for (NodeId f = 0; f + 1 < 6; ++f) {
      const NodeId i = 10 * f + s, j = i + 10;
      scene.edges.push_back({i, j, scene.truth(i).transpose() * scene.truth(j), 1.0});
    }
  }
  const MeasurementGraph graph(scene.edges);
  const RigSolution solution = solve_rigs(graph, scene.rigs);
  CHECK_FALSE(solution.rigs.determined[1]);
  CHECK(solution.objective < 1e-20);
}

TEST_CASE("wrong edges do not move sensors under a robust loss") {
  test::Random random;
  INFO(random.replay());
  Scene scene = make_scene(random, 10, 3, 0.01, all_see_all);
  for (std::size_t k = 0; k < scene.edges.size(); k += 4) {
    scene.edges[k].i_from_j = random_turn(random, 3.0);
  }
  const MeasurementGraph graph(scene.edges);
  const RigSolution plain = solve_rigs(graph, scene.rigs);
  const RigSolution robust = solve_rigs(graph, scene.rigs, {}, {}, RobustOptions{});
  CHECK(largest_error(robust.rigs, scene) < 0.01);
  CHECK(largest_error(plain.rigs, scene) > largest_error(robust.rigs, scene));
  CHECK(robust.certificate.verdict == Verdict::proved);
}

TEST_CASE("gravity and fixed rotations hold frames while sensors are found") {
  test::Random random;
  INFO(random.replay());
  Scene scene = make_scene(random, 6, 2, 0.0, all_see_all);
  Priors priors;
  priors.fixed.push_back({0, scene.truth(0)});
  priors.gravity.push_back({31, scene.truth(31).transpose() * Vector3::UnitY(), 1.0});
  const MeasurementGraph graph(scene.edges);
  const RigSolution solution = solve_rigs(graph, scene.rigs, priors);
  for (Index i = 0; i < graph.num_nodes(); ++i) {
    CHECK(angle_between(solution.rotations[static_cast<std::size_t>(i)],
                        scene.truth(graph.nodes()[static_cast<std::size_t>(i)])) < 1e-7);
  }
  priors.fixed = {{1, scene.truth(1)}};  // of the sensor that is not known
  CHECK_THROWS_AS(solve_rigs(graph, scene.rigs, priors), InvalidPrior);
}

TEST_CASE("rigs that cannot be are refused") {
  test::Random random;
  INFO(random.replay());
  const Scene scene = make_scene(random, 3, 2, 0.0, all_see_all);
  const MeasurementGraph graph(scene.edges);
  const auto refuses = [&](Rigs rigs) { CHECK_THROWS_AS(RigLayout(graph, rigs), InvalidPrior); };
  refuses({{{99, 0, 0}}, {}});
  refuses({{{0, 0, 0}, {0, 1, 0}}, {}});
  refuses({{{0, 0, 0}, {1, 0, 0}}, {}});
  refuses({{{0, 0, 0}}, {{3, Matrix3::Identity()}}});
  refuses({{{0, 0, 0}}, {{0, 2.0 * Matrix3::Identity()}}});
  refuses({{{0, 0, 0}}, {{0, Matrix3::Identity()}, {0, Matrix3::Identity()}}});
  const RigLayout layout(graph, {{{0, 5, 1}, {1, 5, 2}, {10, 6, 2}}, {}});
  CHECK(layout.origin() ==
        std::vector<SensorOrigin>{SensorOrigin::reference, SensorOrigin::estimated});
}

TEST_CASE("the median of rotations is where most are") {
  test::Random random;
  INFO(random.replay());
  const Matrix3 centre = random_turn(random, 2.0);
  Rotations given;
  for (int k = 0; k < 40; ++k) {
    given.push_back(k % 5 < 3 ? Matrix3(centre * random_turn(random, 1e-4))
                              : random_turn(random, 3.0));
  }
  CHECK(angle_between(median_rotation(given), centre) < 1e-3);
  CHECK(angle_between(median_rotation({centre}), centre) < 1e-14);
}
