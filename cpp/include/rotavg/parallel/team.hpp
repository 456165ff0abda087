#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <ctime>
#include <exception>
#include <memory>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

#if __has_include(<unistd.h>)
#include <unistd.h>
#endif

#include <rotavg/types.hpp>

/// Before a function whose arithmetic is to have the same bits wherever it is called from: the
/// compiler may contract a product and a sum in one copy of the code and not in another.
#if defined(__clang__)
#define ROTAVG_ONE_COPY __attribute__((noinline))
#elif defined(__GNUC__)
#define ROTAVG_ONE_COPY __attribute__((noinline, noclone))
#else
#define ROTAVG_ONE_COPY
#endif

namespace rotavg {

/// The threads that help the calling one. All that is parallel here is one thing: tasks 0 … count-1
/// that do not depend on one another, which the calling thread takes one after the other, and its
/// helpers with it as they come. It waits for nobody who has not come, and never busily for long:
/// on processors that others use it goes through the tasks alone, as one thread would. Which thread
/// takes a task decides nothing about what the task computes. And where a job lost more to its
/// helpers than they worked for it, it does without them for some time: for twice what that lost,
/// which may have been chance, and for longer and longer where it happens again, up to fifty times.
/// So do all jobs where helpers were held up in the middle of a task, by other programs; where they
/// were only not worth the call, it is this kind of job alone, and others may be longer.
///
/// Every thread that calls has its own team, made when it is first needed; helpers sleep between
/// calls. After a fork the child makes a new one.
class Team {
 public:
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;
  ~Team() {
    is_busy() = true;  // what this thread's other destructors call gets no help any more
    leave_to_parent();
    if (!state_) return;
    state_->post(nullptr, static_cast<int>(state_->helpers.size()), /*last=*/true);
    for (std::thread& helper : state_->helpers) helper.join();
  }

  /// Calls task(k) for k = 0 … count-1, on at most `num_threads` threads; and, now and then on the
  /// calling thread while it has nothing else to do, idle(). What one of them throws is thrown here
  /// once all that were begun have ended. What a task calls in turn stays on its thread.
  template <typename Task, typename Idle>
  static void run(Index count, int num_threads, const Task& task, const Idle& idle) {
    num_threads = static_cast<int>(std::min<Index>(num_threads, count));
    if (num_threads <= 1 || is_busy()) {  // small fronts come here by the thousand
      go_alone(count, task);
    } else {
      mine().share(count, num_threads, task, idle);
    }
  }

 private:
  using Clock = std::chrono::steady_clock;
  /// As long as it takes to wake a thread, about: who sleeps later, sleeps in vain.
  static constexpr std::chrono::microseconds patience{60};

  Team() = default;
  /// That of the calling thread.
  static Team& mine() {
    thread_local Team team;
    return team;
  }

  template <typename Task>
  ROTAVG_ONE_COPY static void call(const void* task, Index k) {
    (*static_cast<const Task*>(task))(k);
  }
  template <typename Task>
  static void go_alone(Index count, const Task& task) {
    for (Index k = 0; k < count; ++k) call<Task>(&task, k);
  }

  /// Whether helpers are worth their price, as far as some jobs have told.
  struct Trust {
    Clock::time_point alone_until{};
    Clock::duration owed{};  ///< by helpers: what they lost and have not made good
    int distrust = least;    ///< how many times what was lost it goes on alone

    static constexpr int least = 2, most = 50;

    void learn(Clock::duration lost, Clock::time_point now) {
      constexpr Clock::duration longest = std::chrono::seconds(1), none = Clock::duration::zero();
      owed = std::max(none, owed + lost);
      if (lost > none) {
        alone_until = now + std::min(distrust * lost, longest);
        distrust = std::min(2 * distrust, most);
      } else if (owed == none) {
        distrust = std::max(distrust / 2, least);
      }
    }
  };
  /// What the calling thread knows of one kind of job.
  template <typename Task>
  static Trust& trust_in() {
    thread_local Trust trust;
    return trust;
  }

  template <typename Task, typename Idle>
  void share(Index count, int num_threads, const Task& task, const Idle& idle) {
    Trust& in_job = trust_in<Task>();
    const bool alone = Clock::now() < std::max(in_job.alone_until, in_helpers_.alone_until);
    if (!alone) hire(num_threads - 1);
    const AtTask at_task;  // alone or not, what a task calls stays here
    if (alone) return go_alone(count, task);
    const auto before = Clock::now();
    Job job(&task, call<Task>, count, num_threads - 1);
    state_->post(&job, num_threads - 1);
    const auto posted = Clock::now();
    job.work();
    const auto done = Clock::now();
    state_->finish([&] { job.guarded(idle); });
    const auto after = Clock::now();
    const Clock::duration lost = (posted - before) + (after - done) - Clock::duration(job.helped);
    const bool held_up = after - done > patience;  // or its last task was long
    if (held_up || lost <= Clock::duration::zero()) in_helpers_.learn(lost, after);
    if (!held_up) in_job.learn(lost, after);
    job.rethrow();
  }

  struct Job {
    Job(const void* task_, void (*call_)(const void*, Index), Index count_, int places_)
        : task(task_), call(call_), count(count_), places(places_) {}

    void help() {
      if (places.fetch_sub(1) <= 0) return;
      const Clock::duration before = processor_time();
      work();
      helped += (processor_time() - before).count();
    }
    void work() {
      guarded([this] {
        for (Index k; (k = next.fetch_add(1, std::memory_order_relaxed)) < count;) call(task, k);
      });
    }
    /// Keeps the first exception; no further task begins.
    template <typename Function>
    void guarded(const Function& f) noexcept {
      try {
        f();
      } catch (...) {
        if (!failed.exchange(true)) error = std::current_exception();
        next = count;
      }
    }
    void rethrow() const {
      if (error) std::rethrow_exception(error);
    }

    const void* task;
    void (*call)(const void*, Index);
    Index count;
    std::atomic<Index> next{0};
    std::atomic<int> places;                      // for helpers
    std::atomic<Clock::duration::rep> helped{0};  // by them: processor time
    std::atomic<bool> failed{false};
    std::exception_ptr error;  // read once no helper is inside
  };

  /// What the threads share. A helper counts itself in before it looks for a job, and the calling
  /// thread takes the job away before it looks whether anybody is in: so one of them sees the
  /// other.
  struct State {
    std::atomic<Job*> job{nullptr};
    std::atomic<std::uint32_t> number{0};  // of jobs so far
    std::atomic<int> inside{0};            // helpers that may hold the job
    std::atomic<int> asleep{0};
    std::atomic<bool> caller_sleeps{false}, over{false};
    std::mutex mutex;
    std::condition_variable wake, finished;
    std::vector<std::thread> helpers;

    void post(Job* next, int wanted, bool last = false) {
      over = last;
      job = next;
      ++number;
      int sleepers = asleep;
      if (sleepers == 0) return;
      {
        const std::lock_guard<std::mutex> lock(mutex);
      }  // they sleep by now, or have seen it
      for (; sleepers > 0 && wanted > 0; --sleepers, --wanted) wake.notify_one();
    }

    template <typename Idle>
    void finish(const Idle& idle) {
      job = nullptr;
      if (spin([this] { return inside == 0; })) return;
      std::unique_lock<std::mutex> lock(mutex);
      caller_sleeps = true;
      constexpr std::chrono::milliseconds between_calls{10};
      while (!finished.wait_for(lock, between_calls, [this] { return inside == 0; })) {
        lock.unlock();
        idle();
        lock.lock();
      }
      caller_sleeps = false;
    }

    void help(std::uint32_t seen) {
      for (;;) {
        const auto posted = [&] { return number != seen; };
        if (!spin(posted)) {
          std::unique_lock<std::mutex> lock(mutex);
          ++asleep;
          wake.wait(lock, posted);
          --asleep;
        }
        seen = number;
        if (over) return;
        ++inside;
        if (Job* const current = job) current->help();
        if (--inside == 0 && caller_sleeps) {
          const std::lock_guard<std::mutex> lock(mutex);
          finished.notify_one();
        }
      }
    }
  };

  /// Whether this thread is at a task, so that it gets no help with what that calls.
  static bool& is_busy() {
    thread_local bool busy = false;
    return busy;
  }

  struct AtTask {
    AtTask() { is_busy() = true; }
    ~AtTask() { is_busy() = false; }
    AtTask(const AtTask&) = delete;
    AtTask& operator=(const AtTask&) = delete;
  };

  /// Waits a short while for something; returns whether it has come.
  template <typename Condition>
  static bool spin(const Condition& holds) {
    const auto until = Clock::now() + patience;
    do {
      for (int k = 0; k < 16; ++k) {
        if (holds()) return true;
#if defined(__x86_64__) || defined(__i386__)
        __builtin_ia32_pause();
#endif
      }
    } while (Clock::now() < until);
    return holds();
  }

  void hire(int helpers) {
    leave_to_parent();
    if (!state_) {
      state_ = std::make_unique<State>();
      process_ = process();
    }
    try {
      while (static_cast<int>(state_->helpers.size()) < helpers) {
        state_->helpers.emplace_back([state = state_.get(), seen = state_->number.load()] {
          is_busy() = true;
          state->help(seen);
        });
      }
    } catch (const std::system_error&) {  // the system gives no more: fewer do
    }
  }

  /// After a fork the helpers are the parent's alone.
  void leave_to_parent() {
    if (state_ && process() != process_) static_cast<void>(state_.release());
  }
  static long process() {
#if __has_include(<unistd.h>)
    return getpid();
#else
    return 0;
#endif
  }

  /// Of this thread, without the time when others had its processor.
  static Clock::duration processor_time() {
#ifdef CLOCK_THREAD_CPUTIME_ID
    timespec time;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    const auto exact = std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
    return std::chrono::duration_cast<Clock::duration>(exact);
#else
    return Clock::now().time_since_epoch();
#endif
  }

  std::unique_ptr<State> state_;
  long process_ = 0;
  Trust in_helpers_;
};

}  // namespace rotavg
