// One loop over the indices of a box (bricks, tiles, cells or samples), and the index of a number.
#pragma once

#include <utility>

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

inline bool contains(const IndexBox& box, const Index3& index) {
  const Index3 end = box.end();
  return index.x >= box.first.x && index.y >= box.first.y && index.z >= box.first.z &&
         index.x < end.x && index.y < end.y && index.z < end.z;
}

// The least box around both; an empty box adds nothing.
inline IndexBox unionOf(const IndexBox& a, const IndexBox& b) {
  if (a.size() == 0) return b;
  if (b.size() == 0) return a;
  const Index3 first = glm::min(a.first, b.first);
  return {first, glm::max(a.end(), b.end()) - first};
}

// The part that both have; a box of no size if there is none.
inline IndexBox intersectionOf(const IndexBox& a, const IndexBox& b) {
  const Index3 first = glm::max(a.first, b.first);
  const Index3 count = glm::min(a.end(), b.end()) - first;
  if (count.x <= 0 || count.y <= 0 || count.z <= 0) return {};
  return {first, count};
}

// The index whose linearIndex() in a block of `dims` is `i`.
inline Index3 indexAt(std::int64_t i, const Index3& dims) {
  return {i % dims.x, i / dims.x % dims.y, i / (dims.x * dims.y)};
}

// Calls f(index) for every index in the box, x fastest, then y, then z.
template <typename F>
void forEachIndex(const IndexBox& box, F&& f) {
  const Index3 end = box.end();
  Index3 index;
  for (index.z = box.first.z; index.z < end.z; ++index.z)
    for (index.y = box.first.y; index.y < end.y; ++index.y)
      for (index.x = box.first.x; index.x < end.x; ++index.x) f(std::as_const(index));
}

}  // namespace isobrick
