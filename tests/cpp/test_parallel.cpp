#ifdef __linux__
#include <sys/wait.h>
#include <unistd.h>
#endif

#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <thread>
#include <vector>

#include <doctest/doctest.h>

#include <rotavg/parallel/interruption.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/team.hpp>
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
  std::atomic<int> calls{0};  // more threads are asked for than any system has
  rotavg::parallel_for(12, std::numeric_limits<int>::max(), [&](Index) { ++calls; });
  CHECK(calls == 12);
}

TEST_CASE("a loop within a loop stays on its thread, and calls from several threads do not mix") {
  const auto count_all = [] {
    std::vector<int> calls(200 * 50, 0);
    for (int times = 0; times < 20; ++times) {
      rotavg::parallel_for(200, 4, [&](Index i) {
        const auto here = std::this_thread::get_id();
        rotavg::parallel_for(50, 4, [&](Index j) {
          calls[static_cast<std::size_t>(50 * i + j)] += here == std::this_thread::get_id();
        });
      });
    }
    return calls;
  };
  const std::vector<int> expected(200 * 50, 20);
  std::vector<std::vector<int>> found(3);
  std::vector<std::thread> threads;
  for (auto& calls : found) threads.emplace_back([&] { calls = count_all(); });
  for (std::thread& thread : threads) thread.join();
  for (const auto& calls : found) CHECK(calls == expected);
}

TEST_CASE("helpers take tasks while the calling thread is at one of its own") {
  // Two tasks that wait for each other can only end together; a team that has just lost time goes
  // alone for a while.
  std::atomic<bool> met{false};
  for (int times = 0; times < 200 && !met; ++times) {
    std::atomic<int> arrived{0};
    rotavg::Team::run(
        2, 2,
        [&](Index) {
          ++arrived;
          const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(50);
          while (arrived < 2 && std::chrono::steady_clock::now() < until) std::this_thread::yield();
          if (arrived == 2) met = true;
        },
        [] {});
  }
  CHECK(met);
}

TEST_CASE("the calling thread is asked now and then while it waits for a helper's long task") {
  bool asked = false;
  for (int times = 0; times < 50 && !asked; ++times) {
    const auto caller = std::this_thread::get_id();
    rotavg::Team::run(
        2, 2,
        [&](Index) {
          if (std::this_thread::get_id() == caller) {
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
          } else {
            std::this_thread::sleep_for(std::chrono::milliseconds(60));
          }
        },
        [&] { asked = std::this_thread::get_id() == caller; });
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  CHECK(asked);
}

#ifdef __linux__
TEST_CASE("the child of a fork has threads of its own") {
  const auto sum = [] {
    return rotavg::block_sum<double>(100000, 4, [](Index k) { return 1.0 / (1.0 + k); });
  };
  const double expected = sum();
  const pid_t child = fork();
  if (child == 0) _exit(sum() == expected && sum() == expected ? 0 : 1);
  int status = -1;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 0);
}
#endif

TEST_CASE("what a thread destroys may still be parallel, when its team is gone") {
  struct Last {
    double* sum = nullptr;
    ~Last() {
      *sum = rotavg::block_sum<double>(100000, 4, [](Index k) { return 1.0 / (1.0 + k); });
    }
  };
  const auto term = [](Index k) { return 1.0 / (1.0 + k); };
  double sum = 0.0;
  std::thread([&] {
    thread_local Last last;  // before the team, so destroyed after it
    last.sum = &sum;
    CHECK(rotavg::block_sum<double>(100000, 4, term) > 0.0);
  }).join();
  CHECK(sum == rotavg::block_sum<double>(100000, 4, term));
}

TEST_CASE("an interruption asks only on its own thread, and stops for all") {
  int asked = 0;
  const std::function<bool()> no = [&] { return ++asked < 1; };
  rotavg::Interruption interruption(no);
  std::thread([&] {
    for (int k = 0; k < 100; ++k) CHECK(interruption.goes_on(1e7));
  }).join();
  CHECK(asked == 0);
  CHECK(interruption.goes_on(1e6));
  CHECK(asked == 0);
  CHECK(!interruption.goes_on(1e7));
  CHECK(asked == 1);
  CHECK(!interruption.goes_on(1.0));
  CHECK(!interruption.ask());
  CHECK(asked == 1);
  std::thread([&] { CHECK(!interruption.goes_on(1.0)); }).join();
}

TEST_CASE("little work gets one thread, much work as many as were asked for") {
  CHECK(rotavg::resolve_num_threads(7, 100) == 1);
  CHECK(rotavg::resolve_num_threads(7, 1000000) == 7);
  CHECK(rotavg::resolve_num_threads(0, 1000000) >= 1);
  CHECK(rotavg::resolve_num_threads(-1, 1000000) == rotavg::resolve_num_threads(0, 1000000));
  CHECK(rotavg::threads_for(1, 1e12) == 1);
  CHECK(rotavg::threads_for(5, 1e12) == 5);
  CHECK(rotavg::threads_for(5, 0.0) == 1);
}

TEST_CASE("what a task throws is thrown where the tasks were called, and the team goes on") {
  for (const int num_threads : {1, 2, 4}) {
    for (const Index bad : {0, 17, 99}) {
      CAPTURE(num_threads);
      CAPTURE(bad);
      CHECK_THROWS_AS(rotavg::parallel_for(100, num_threads,
                                           [&](Index k) {
                                             if (k == bad) throw std::runtime_error("mine");
                                           }),
                      std::runtime_error);
      std::vector<int> done(1000, 0);
      rotavg::parallel_for(1000, num_threads,
                           [&](Index k) { done[static_cast<std::size_t>(k)] += 1; });
      CHECK(done == std::vector<int>(1000, 1));
    }
  }
}
