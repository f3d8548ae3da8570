#include "isobrick/storage/remote/range_queue.h"

#include <algorithm>
#include <iterator>

namespace isobrick {
namespace {

// The bytes that one request would bring, and those of them that are not wanted.
struct JoinedSpan {
  std::uint64_t begin = 0, end = 0, gap_bytes = 0;

  // True if the range is worth joining. If it goes behind those in the span, it begins no earlier
  // than they; if it goes in front, it ends no later.
  bool mayTake(const ByteRange& range) const {
    const JoinedSpan joined = with(range);
    const std::uint64_t bytes = joined.end - joined.begin;
    const std::uint64_t gap = joined.gap_bytes - gap_bytes;
    return bytes <= RangeQueue::kMostRequestBytes && gap <= RangeQueue::kMostGapBytes &&
           (gap <= RangeQueue::kFreeGapBytes || joined.gap_bytes <= (bytes - joined.gap_bytes) / 8);
  }
  JoinedSpan with(const ByteRange& range) const {
    const std::uint64_t range_end = range.offset + range.bytes;
    JoinedSpan joined{std::min(begin, range.offset), std::max(end, range_end), gap_bytes};
    if (range.offset > end) joined.gap_bytes += range.offset - end;
    if (range_end < begin) joined.gap_bytes += begin - range_end;
    return joined;
  }
};

}  // namespace

void RangeQueue::push(Wanted wanted) {
  by_offset_.emplace(wanted->range.offset, wanted);
  (wanted->is_awaited ? awaited_ : announced_).push_back(std::move(wanted));
}

void RangeQueue::hurry(const Wanted& wanted) {
  wanted->is_awaited = true;
  awaited_.push_back(wanted);
}

void RangeQueue::remove(const Wanted& wanted) {
  const auto [first, last] = by_offset_.equal_range(wanted->range.offset);
  const auto found =
      std::find_if(first, last, [&](const auto& entry) { return entry.second == wanted; });
  if (found != last) by_offset_.erase(found);
}

std::vector<RangeQueue::Wanted> RangeQueue::pop() {
  const auto place = [&](const Wanted& wanted) {
    const auto [first, last] = by_offset_.equal_range(wanted->range.offset);
    const auto found =
        std::find_if(first, last, [&](const auto& entry) { return entry.second == wanted; });
    return found == last ? by_offset_.end() : found;
  };
  auto seed = by_offset_.end();
  for (std::deque<Wanted>* queue : {&awaited_, &announced_})
    while (seed == by_offset_.end() && !queue->empty()) {
      seed = place(queue->front());
      queue->pop_front();
    }
  if (seed == by_offset_.end()) return {};

  const ByteRange& range = seed->second->range;
  JoinedSpan span{range.offset, range.offset + range.bytes, 0};
  auto first = seed, last = std::next(seed);
  while (last != by_offset_.end() && span.mayTake(last->second->range))
    span = span.with((last++)->second->range);
  while (first != by_offset_.begin() && span.mayTake(std::prev(first)->second->range))
    span = span.with((--first)->second->range);

  std::vector<Wanted> joined;
  for (auto at = first; at != last; ++at) joined.push_back(std::move(at->second));
  by_offset_.erase(first, last);
  return joined;
}

}  // namespace isobrick
