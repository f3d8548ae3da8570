// Ranges that wait for a request, and which of them one request brings.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/storage/range_reader.h"

namespace isobrick {

// A range that is wanted, with its bytes as far as they are here.
struct WantedRange {
  enum class State : std::uint8_t { kQueued, kUnderway, kHere, kFailed };

  ByteRange range;
  State state = State::kQueued;
  bool is_awaited = false;  // rather than announced alone
  int readers = 0;          // that wait for it
  std::uint64_t ahead = 0;  // its number among those that are not read yet; 0: it is none of them
  std::unique_ptr<std::byte[]> data;
  std::string failure;  // of a failed one

  std::uint64_t end() const { return range.offset + range.bytes; }
};

// A queue of ranges, without a lock. Awaited ranges go before announced ones, else the first that
// came; and with it its neighbours, as far as one request for all of them is cheaper.
//
// A request costs a round trip of one of a few dozens underway, and some hundred bytes of headers;
// in most networks that is as long as some ten thousand bytes take. So a gap of kMostGapBytes is
// read over. All gaps of a request together are at most an eighth of its wanted bytes, but for
// those that are smaller than the headers: so many small ranges with gaps between them cause few
// unwanted bytes.
class RangeQueue {
 public:
  static constexpr std::uint64_t kMostGapBytes = std::uint64_t{32} << 10;
  static constexpr std::uint64_t kFreeGapBytes = 512;
  // Longer ranges, and more neighbours, are for several requests: side by side they are faster.
  static constexpr std::uint64_t kMostRequestBytes = std::uint64_t{1} << 20;

  using Wanted = std::shared_ptr<WantedRange>;

  void push(Wanted wanted);
  // It is awaited from now on.
  void hurry(const Wanted& wanted);
  void remove(const Wanted& wanted);
  bool empty() const { return by_offset_.empty(); }
  // Whether any of them is awaited; may be true for a moment yet when none is any more.
  bool hasAwaited() const { return !awaited_.empty(); }

  // Those of the next request, in the order of their offsets; empty if none waits.
  std::vector<Wanted> pop();

 private:
  using ByOffset = std::multimap<std::uint64_t, Wanted>;

  ByOffset by_offset_;                      // all that wait
  std::deque<Wanted> awaited_, announced_;  // those of by_offset_, and such as went with others
};

}  // namespace isobrick
