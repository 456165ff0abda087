#include <functional>
#include <tuple>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/init/shortest_path.hpp>
#include <rotavg/problem/objective.hpp>
#include <rotavg/solve/accelerated.hpp>
#include <rotavg/solve/anderson.hpp>
#include <rotavg/solve/bcd.hpp>
#include <rotavg/solve/solve.hpp>
#include <rotavg/solve/sum.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

using Solver = std::function<IterationResult(const MeasurementGraph&, Rotations, IterationOptions)>;

const Solver plain_bcd = [](const auto& graph, auto R, auto options) {
  return bcd(graph, std::move(R), options);
};
const Solver plain_sum = [](const auto& graph, auto R, auto options) {
  return sum(graph, std::move(R), options);
};
const Solver fast_bcd = [](const auto& graph, auto R, auto options) {
  return accelerated_bcd(graph, std::move(R), options);
};
const Solver fast_sum = [](const auto& graph, auto R, auto options) {
  return accelerated_sum(graph, std::move(R), options);
};

}  // namespace

TEST_CASE("on ill-conditioned graphs mixing saves five iterations in six, to the same optimum") {
  Random random;
  INFO(random.replay());
  for (const test::Pairs& pairs :
       {test::cycle(60), test::cycle(61), test::grid(15, 15), test::grid(2, 40)}) {
    const MeasurementGraph graph = test::simulate_graph(random, pairs, 0.1);
    const Rotations start = shortest_path_init(graph);
    IterationOptions options;
    options.tolerance = 1e-10;
    CAPTURE(graph.num_nodes());
    CAPTURE(graph.num_edges());
    for (const auto& [plain, fast, sweeps] :
         {std::tuple(&plain_bcd, &fast_bcd, 2), std::tuple(&plain_sum, &fast_sum, 1)}) {
      const IterationResult slow = (*plain)(graph, start, options);
      const IterationResult quick = (*fast)(graph, start, options);
      CAPTURE(sweeps);
      REQUIRE(slow.status == Status::gradient_converged);
      CHECK(quick.status == Status::gradient_converged);
      CHECK(quick.objective == doctest::Approx(slow.objective).epsilon(1e-9));
      CHECK(6 * sweeps * quick.iterations < slow.iterations);
    }
  }
}

TEST_CASE("where little is to be gained, little is lost") {
  Random random;
  INFO(random.replay());
  for (const double noise : {0.2, 0.5}) {
    const MeasurementGraph graph = test::paper_graph(random, 60, noise, 0.3);
    const Rotations start = shortest_path_init(graph);
    CHECK(accelerated_bcd(graph, start).iterations <= bcd(graph, start).iterations);
    CHECK(accelerated_sum(graph, start).iterations <= sum(graph, start).iterations + 1);
    const MuRule rule = MuRule::min_eigenvalue;
    const IterationResult slow = sum(graph, start, {}, rule);
    const IterationResult quick = accelerated_sum(graph, start, {}, rule);
    CHECK(quick.iterations < slow.iterations);
    CHECK(quick.objective == doctest::Approx(slow.objective).epsilon(1e-9));
  }
}

TEST_CASE("every iteration ends no higher than the plain step from where it began") {
  Random random;
  INFO(random.replay());
  for (const test::Pairs& pairs :
       {test::cycle(16), test::grid(6, 6), test::random_connected(random, 30, 40)}) {
    for (const double noise : {0.1, 2.0}) {
      const MeasurementGraph graph = test::simulate_graph(random, pairs, noise);
      const Rotations start = random.rotations(graph.num_nodes());
      Monitor monitor(graph, start, {});
      std::vector<double> after_plain_step;
      int calls = 0;
      const auto step = [&](const Quaternions& q, const ResidualQuaternions& at, Quaternions& next,
                            ResidualQuaternions& after) {
        CHECK(at.objective() == objective(graph, q, 1));
        ++calls;
        next = q;
        bcd_sweep(graph, next, monitor);
        after.update(next);
        after_plain_step.push_back(after.objective());
      };
      const auto measure = [](const Quaternions&, const Quaternions&) { return 0.0; };
      const IterationResult result =
          accelerate<ResidualQuaternions>(graph, start, monitor, step, measure);
      REQUIRE(calls == result.iterations);
      int below = 0;
      for (int k = 0; k < result.iterations; ++k) {
        const double f = after_plain_step[k], reached = result.trace[k + 1].objective;
        REQUIRE(reached <= f + objective_rounding(graph, f));
        below += reached < f ? 1 : 0;
      }
      CHECK(4 * below > result.iterations);  // the mixing is used, not only guarded against
    }
  }
}

TEST_CASE("of an affine step the mixing finds the fixed point within as many steps as dimensions") {
  // Around the identity, SO(3) is nearly its tangent space: three nodes, turned a little, of which
  // each coordinate shrinks by a factor of its own.
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::complete(3), 0.0);
  const std::vector<double> factor = {0.9, -0.7, 0.5};
  const double size = 1e-5;
  const auto step = [&](const Quaternions& q) {
    Quaternions next;
    for (const Quaternion& q_l : q) {
      const Vector3 w = log_so3(q_l.toRotationMatrix());
      next.push_back(turned(Quaternion::Identity(),
                            {factor[0] * w.x(), factor[1] * w.y(), factor[2] * w.z()}));
    }
    return next;
  };
  AndersonMixing anderson(graph, 1);
  Quaternions q, mixed;
  for (int l = 0; l < 3; ++l)
    q.push_back(turned(Quaternion::Identity(), size * random.direction()));
  for (int k = 0; k < 4; ++k) {
    Quaternions next = step(q);
    for (Quaternion& q_l : next) {  // the sign says nothing
      if (random.coin()) q_l.coeffs() = -q_l.coeffs();
    }
    CHECK(anderson.mix(q, next, mixed) == (k > 0));
    q = k > 0 ? mixed : next;
  }
  const auto angle = [](const Quaternion& q_l) { return log_so3(q_l.toRotationMatrix()).norm(); };
  for (const Quaternion& q_l : q) CHECK(angle(q_l) < 1e-4 * size);
  Quaternions plain;
  for (int l = 0; l < 3; ++l) plain.push_back(turned(Quaternion::Identity(), {size, 0.0, 0.0}));
  for (int k = 0; k < 4; ++k) plain = step(plain);
  CHECK(angle(plain[0]) > 0.6 * size);
}

TEST_CASE("solve accelerates BCD and SUM where it is asked to") {
  Random random;
  INFO(random.replay());
  const MeasurementGraph graph = test::simulate_graph(random, test::grid(15, 15), 0.2);
  for (const Method method : {Method::bcd, Method::sum}) {
    SolveOptions options;
    options.method = method;
    const Solution plain = solve(graph, options);
    options.accelerate = true;
    const Solution fast = solve(graph, options);
    CHECK(fast.method == method);
    CHECK(fast.certificate.verdict == Verdict::proved);
    CHECK(fast.objective == doctest::Approx(plain.objective).epsilon(1e-9));
    CHECK(4 * fast.iterations < plain.iterations);
  }
}
