// The reads of a cache for a recorded sequence of parts.
#pragma once

#include <cstdint>
#include <vector>

namespace isobrick::test {

struct Take {
  std::uint64_t id = 0;
  std::uint64_t bytes = 0;  // of the part, read or held; the same each time
};

// A query after the other, and in each the parts in the order in which it takes them.
using TakeTrace = std::vector<std::vector<Take>>;

// Bytes of all parts that occur, each once.
std::uint64_t workingSetBytes(const TakeTrace& trace);

// Bytes that come in with a budget of `budget_bytes`, where the least recently used goes.
std::uint64_t bytesReadByLru(const TakeTrace& trace, std::uint64_t budget_bytes);

// Where the one goes that is taken again last: the optimum for parts of one size (Belady, 1966),
// and near it for others.
std::uint64_t bytesReadByBelady(const TakeTrace& trace, std::uint64_t budget_bytes);

// Where ResidencePolicy has its way.
std::uint64_t bytesReadByPolicy(const TakeTrace& trace, std::uint64_t budget_bytes);

}  // namespace isobrick::test
