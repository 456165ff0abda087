#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/rotavg.hpp>

#include "support/graphs.hpp"
#include "support/random.hpp"

using namespace rotavg;
using rotavg::test::Random;

namespace {

// Sanitizers and counted lines take up to fifty times as long, and want each thing done but once.
#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)  // g++
#define ROTAVG_TEST_SLOW
#elif defined(__has_feature)  // clang
#if __has_feature(thread_sanitizer) || __has_feature(address_sanitizer)
#define ROTAVG_TEST_SLOW
#endif
#endif
#if defined(ROTAVG_TEST_SLOW)
const std::vector<Initialization> starts = {Initialization::automatic};
const std::vector<int> numbers_of_threads = {3};
#else
const std::vector<Initialization> starts = {Initialization::automatic, Initialization::chordal};
const std::vector<int> numbers_of_threads = {2, 3, 8};
#endif

test::Pairs band(Index n, Index width) {
  test::Pairs pairs;
  for (Index i = 0; i < n; ++i) {
    for (Index d = 1; d <= width && i + d < n; ++d) pairs.emplace_back(i, i + d);
  }
  return pairs;
}

}  // namespace

TEST_CASE("starts, solutions and proofs have the same bits for any number of threads") {
  Random random;
  INFO(random.replay());
  // Large enough for several threads in every stage: Newton's method, sweeps by colours, SUM;
  // factorisations, random starts, connectivity.
  struct Case {
    const char* name;
    test::Pairs pairs;
    double noise;
  };
  const std::vector<Case> cases = {
      {"grid", test::grid(110, 110), 0.05},
      {"band", band(3000, 10), 0.1},
      {"expander", test::random_connected(random, 2500, 28000), 0.1},
      // The start is the solution: nobody asks for what is made ready beside it.
      {"grid, exact", test::grid(110, 110), 0.0},
      {"band, exact", band(3000, 10), 0.0},
      {"sparse random", test::random_connected(random, 1200, 2400), 0.1},
      {"complete", test::complete(260), 0.2}};
  for (const Case& c : cases) {
    const MeasurementGraph graph = test::simulate_graph(random, c.pairs, c.noise);
    for (const Initialization init : starts) {
      SolveOptions options;
      options.init = init;
      options.iteration.num_threads = 1;
      const Solution one = solve(graph, options);
      CAPTURE(c.name);
      CHECK(one.certificate.verdict == Verdict::proved);
      for (const int num_threads : numbers_of_threads) {
        options.iteration.num_threads = num_threads;
        const Solution several = solve(graph, options);
        CAPTURE(num_threads);
        CHECK(several.rotations == one.rotations);
        CHECK(several.objective == one.objective);
        CHECK(several.gradient_norm == one.gradient_norm);
        CHECK(several.certificate.gap == one.certificate.gap);
        CHECK(several.certificate.lambda_min == one.certificate.lambda_min);
        CHECK(several.certificate.method == one.certificate.method);
      }
    }
  }
}
