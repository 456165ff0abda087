#pragma once

#include <algorithm>
#include <vector>

#include <rotavg/parallel/threads.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Sum of term(k) for k = 0 … count-1. Each block of 64 terms is summed in order by one thread and
/// the block sums are added in order, so the result has the same bits for any number of threads.
///
/// `Value` needs a default constructor that makes zero, and operator+=.
template <typename Value, typename Term>
Value block_sum(Index count, int num_threads, Term&& term) {
  constexpr Index block = 64;
  const Index num_blocks = (count + block - 1) / block;
  std::vector<Value> partial(static_cast<std::size_t>(num_blocks), Value{});
  parallel_for(num_blocks, num_threads, [&](Index b) {
    Value sum{};
    const Index end = std::min(count, (b + 1) * block);
    for (Index k = b * block; k < end; ++k) sum += term(k);
    partial[b] = sum;
  });
  Value total{};
  for (const Value& value : partial) total += value;
  return total;
}

}  // namespace rotavg

#pragma GCC diagnostic pop
