#include "isobrick/extract/simplify/corner_table.h"

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
  findOpposites();
  findRings();
}

void CornerTable::findOpposites() {
  rings_.assign(first_.size() - 1, Ring::kClosed);
  struct Side {
    std::uint32_t to, back;  // the next vertex after the one in the middle, and the one before it
  };
  std::vector<Side> sides;
  for (std::uint32_t from = 0; from < rings_.size(); ++from) {
    const std::span around =
        std::span(around_).subspan(first_[from], first_[from + 1] - first_[from]);
    sides.clear();
    for (const std::uint32_t at : around) sides.push_back({vertex(next(at)), vertex(previous(at))});
    for (std::size_t i = 0; i < sides.size(); ++i) {
      // The side goes from `from` to `to` here, so in the other triangle `to` comes first.
      const std::uint32_t to = sides[i].to;
      std::size_t other = 0;
      int same = 0, opposed = 0;
      for (std::size_t j = 0; j < sides.size(); ++j) {
        if (sides[j].back == to) other = j;
        opposed += sides[j].back == to;
        same += sides[j].to == to;
      }
      if (opposed == 1 && same == 1)
        join(previous(around[i]), next(around[other]));
      else if (opposed + same > 1)
        rings_[from] = rings_[to] = Ring::kBroken;
    }
  }
}

void CornerTable::findRings() {
  for (std::uint32_t vertex = 0; vertex < rings_.size(); ++vertex) {
    const std::uint32_t count = first_[vertex + 1] - first_[vertex];
    if (count == 0 || rings_[vertex] == Ring::kBroken) continue;
    const std::uint32_t start = around_[first_[vertex]];
    std::uint32_t seen = 1;
    std::uint32_t at = left(start);
    for (; at != kNone && at != start && seen <= count; at = left(at)) ++seen;
    if (at == kNone) {
      rings_[vertex] = Ring::kOpen;
      for (at = right(start); at != kNone && seen <= count; at = right(at)) ++seen;
    }
    if (seen != count) rings_[vertex] = Ring::kBroken;
  }
}

void CornerTable::join(std::uint32_t corner, std::uint32_t other) {
  if (corner != kNone) facing(corner) = other;
  if (other != kNone) facing(other) = corner;
}

// The two sides that have the corner become one.
void CornerTable::removeTriangle(std::uint32_t corner) {
  join(opposite(next(corner)), opposite(previous(corner)));
}

void CornerTable::collapse(std::uint32_t corner) {
  const std::uint32_t beyond = opposite(previous(corner));
  const std::uint32_t target = vertex(next(corner));
  for (std::uint32_t at = left(corner); at != corner; at = left(at))
    triangles_[at / 4].vertices[at & 3] = target;
  // At the corners that face the edge both triangles fold together.
  removeTriangle(previous(corner));
  removeTriangle(beyond);
  for (const std::uint32_t of : {corner, beyond}) triangles_[triangleOf(of)].vertices[0] = kNone;
}

}  // namespace isobrick
