#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>

#include "support/random.hpp"

using rotavg::Index;
using rotavg::test::Random;

TEST_CASE("a block sum has the same bits for any number of threads, and is the sum") {
  Random random;
  INFO(random.replay());
  for (const Index count : {0, 1, 63, 64, 65, 127, 128, 129, 1000, 4097}) {
    std::vector<double> terms;
    long double reference = 0.0L;
    double magnitude = 0.0;
    for (Index k = 0; k < count; ++k) {
      terms.push_back(random.normal() * random.power_of_ten(-8, 8));
      reference += static_cast<long double>(terms.back());
      magnitude += std::abs(terms.back());
    }
    const auto term = [&](Index k) { return terms[static_cast<std::size_t>(k)]; };
    const double sum = rotavg::block_sum<double>(count, 1, term);
    CAPTURE(count);
    CHECK(std::abs(sum - static_cast<double>(reference)) <= 1e-14 * magnitude);
    for (const int num_threads : {2, 3, 7, 16}) {
      CAPTURE(num_threads);
      CHECK(rotavg::block_sum<double>(count, num_threads, term) == sum);
    }
  }
}

TEST_CASE("a parallel loop calls its function once for every index") {
  for (const int num_threads : {1, 2, 3, 7}) {
    std::vector<int> calls(1001, 0);
    rotavg::parallel_for(1001, num_threads, [&](Index k) { ++calls[static_cast<std::size_t>(k)]; });
    CHECK(calls == std::vector<int>(1001, 1));
  }
}

TEST_CASE("little work gets one thread, much work as many as were asked for") {
  CHECK(rotavg::resolve_num_threads(7, 100) == 1);
  CHECK(rotavg::resolve_num_threads(7, 1000000) == 7);
  CHECK(rotavg::resolve_num_threads(0, 1000000) >= 1);
  CHECK(rotavg::resolve_num_threads(-1, 1000000) == rotavg::resolve_num_threads(0, 1000000));
}
