#include "isobrick/extract/simplify/corner_table.h"

#include <algorithm>

namespace isobrick {

void CornerTable::set(std::span<const std::uint32_t> triangles, std::size_t vertices) {
  triangles_.resize(triangles.size() / 3);
  first_.assign(vertices + 1, 0);
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    triangles_[t] = {{triangles[3 * t], triangles[3 * t + 1], triangles[3 * t + 2]},
                     {kNone, kNone, kNone}};
    for (int c = 0; c < 3; ++c) ++first_[triangles[3 * t + static_cast<std::size_t>(c)]];
  }
  std::uint32_t sum = 0;
  for (std::uint32_t& first : first_) first = sum += first;
  around_.resize(triangles.size());
  for (std::uint32_t t = this->triangles(); t-- > 0;)
    for (std::uint32_t c = firstCorner(t) + 3; c-- > firstCorner(t);)
      around_[--first_[vertex(c)]] = c;
  rings_.resize(vertices);
  for (std::uint32_t v = 0; v < vertices; ++v) rings_[v] = joinAround(v);
}

// Each triangle has a side from the vertex in the middle to its next one, and a side back from the
// one before. The next triangle clockwise comes back where this one goes.
CornerTable::Ring CornerTable::joinAround(std::uint32_t middle) {
  const std::span around = cornersOf(middle);
  const auto count = static_cast<std::uint32_t>(around.size());
  if (count == 0) return Ring::kClosed;
  around_one_.resize(count);
  for (std::uint32_t i = 0; i < count; ++i)
    around_one_[i] = {vertex(next(around[i])), vertex(previous(around[i]))};
  bool is_ring = true;
  for (Around& one : around_one_) {
    std::uint32_t opposed = 0;
    for (std::uint32_t j = 0; j < count; ++j) {
      const bool is_opposed = around_one_[j].back == one.to;
      opposed += std::uint32_t{is_opposed};
      one.clockwise = is_opposed ? j : one.clockwise;
    }
    is_ring = is_ring && opposed == 1;
  }
  // As a rule all are one ring, and then no side is there twice.
  std::uint32_t at = 0, seen = 0;
  for (; is_ring && seen < count && (seen == 0 || at != 0); ++seen) at = around_one_[at].clockwise;
  const Ring ring = seen == count && at == 0 ? Ring::kClosed : joinStrip();
  for (std::uint32_t i = 0; i < count; ++i)
    if (const std::uint32_t other = around_one_[i].clockwise; other != kNone)
      facing(previous(around[i])) = next(around[other]);
  return ring;
}

// Leaves only what may be joined.
CornerTable::Ring CornerTable::joinStrip() {
  const auto countOf = [&](std::uint32_t Around::*side, std::uint32_t vertex) {
    return std::ranges::count(around_one_, vertex, side);
  };
  bool is_broken = false;
  for (Around& one : around_one_) {
    const auto along = countOf(&Around::to, one.to), opposed = countOf(&Around::back, one.to);
    is_broken = is_broken || along > 1 || opposed > 1 || countOf(&Around::back, one.back) > 1;
    if (along != 1 || opposed != 1) one.clockwise = kNone;
  }
  if (is_broken) return Ring::kBroken;
  // A strip begins with the one whose side back no other goes. What does not follow is apart.
  const auto first = std::ranges::find_if(
      around_one_, [&](const Around& one) { return countOf(&Around::to, one.back) == 0; });
  if (first == around_one_.end()) return Ring::kBroken;
  std::size_t seen = 1;
  for (std::uint32_t at = first->clockwise; at != kNone; at = around_one_[at].clockwise) ++seen;
  return seen == around_one_.size() ? Ring::kOpen : Ring::kBroken;
}

}  // namespace isobrick
