#include "isobrick/extract/self_crossings.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <utility>

namespace isobrick {
namespace {

using Point = glm::i64vec3;
__extension__ using Wide = __int128;  // of three coordinates' product

template <typename Number>
int signOf(Number number) {
  return (number > 0) - (number < 0);
}

// The side of the plane through a, b and c on which d lies; 0: in it.
int sideOf(const Point& a, const Point& b, const Point& c, const Point& d) {
  const Point p = b - a, q = c - a, r = d - a;
  return signOf(Wide(p.x) * (q.y * r.z - q.z * r.y) + Wide(p.y) * (q.z * r.x - q.x * r.z) +
                Wide(p.z) * (q.x * r.y - q.y * r.x));
}

bool areOneWay(int a, int b, int c) {
  return (a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0);
}

// Points that lie in one plane, seen along an axis.
struct Projection {
  int u, v;

  // Along which a triangle has an area; u is below 0 if there is none.
  static Projection of(const Point& a, const Point& b, const Point& c) {
    for (int axis = 0; axis < 3; ++axis)
      if (const Projection seen{(axis + 1) % 3, (axis + 2) % 3}; seen.turn(a, b, c) != 0)
        return seen;
    return {-1, -1};
  }
  int turn(const Point& a, const Point& b, const Point& c) const {
    return signOf((b[u] - a[u]) * (c[v] - a[v]) - (b[v] - a[v]) * (c[u] - a[u]));
  }
  bool isBetween(const Point& a, const Point& b, const Point& p) const {
    return std::min(a[u], b[u]) <= p[u] && p[u] <= std::max(a[u], b[u]) &&
           std::min(a[v], b[v]) <= p[v] && p[v] <= std::max(a[v], b[v]);
  }
  bool doSegmentsMeet(const Point& a, const Point& b, const Point& c, const Point& d) const {
    const int at_c = turn(a, b, c), at_d = turn(a, b, d);
    const int at_a = turn(c, d, a), at_b = turn(c, d, b);
    if (at_c * at_d < 0 && at_a * at_b < 0) return true;
    return (at_c == 0 && isBetween(a, b, c)) || (at_d == 0 && isBetween(a, b, d)) ||
           (at_a == 0 && isBetween(c, d, a)) || (at_b == 0 && isBetween(c, d, b));
  }
};

// A segment and a triangle, ends and sides included.
bool doMeet(const Point& p, const Point& q, const std::array<Point, 3>& triangle) {
  const auto& [a, b, c] = triangle;
  const int at_p = sideOf(a, b, c, p), at_q = sideOf(a, b, c, q);
  if (at_p * at_q > 0) return false;
  if (at_p != 0 || at_q != 0)
    return areOneWay(sideOf(p, q, a, b), sideOf(p, q, b, c), sideOf(p, q, c, a));
  const Projection seen = Projection::of(a, b, c);
  return areOneWay(seen.turn(a, b, p), seen.turn(b, c, p), seen.turn(c, a, p)) ||
         seen.doSegmentsMeet(p, q, a, b) || seen.doSegmentsMeet(p, q, b, c) ||
         seen.doSegmentsMeet(p, q, c, a);
}

// Two triangles with areas; the first `shared` vertices of both are the same.
bool doCross(const std::array<Point, 3>& a, const std::array<Point, 3>& b, std::size_t shared) {
  if (shared == 3) return true;
  if (shared == 2) {
    if (sideOf(a[0], a[1], a[2], b[2]) != 0) return false;
    const Projection seen = Projection::of(a[0], a[1], a[2]);
    return seen.turn(a[0], a[1], a[2]) == seen.turn(a[0], a[1], b[2]);
  }
  // As a rule one lies on one side of the other's plane.
  const auto isBeside = [shared](const std::array<Point, 3>& one,
                                 const std::array<Point, 3>& other) {
    int sum = 0;
    for (std::size_t i = shared; i < 3; ++i) sum += sideOf(one[0], one[1], one[2], other[i]);
    return std::abs(sum) == 3 - static_cast<int>(shared);
  };
  if (isBeside(a, b) || isBeside(b, a)) return false;
  if (shared == 1) return doMeet(a[1], a[2], b) || doMeet(b[1], b[2], a);
  for (std::size_t i = 0; i < 3; ++i)
    if (doMeet(a[i], a[(i + 1) % 3], b) || doMeet(b[i], b[(i + 1) % 3], a)) return true;
  return false;
}

// Puts the vertices that both have first, in the same order; returns how many.
std::size_t alignShared(SelfCrossings::Triangle& a, SelfCrossings::Triangle& b) {
  std::size_t shared = 0;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = shared; j < 3; ++j)
      if (a[i] == b[j]) {
        std::swap(b[j], b[shared]);
        std::swap(a[i], a[shared++]);
        break;
      }
  return shared;
}

}  // namespace

glm::ivec3 SelfCrossings::cellOf(const glm::ivec3& position) const {
  return (position - origin_) / cell_size_;
}

template <typename F>
void SelfCrossings::forEachCellOf(const Box& box, const F& visit) const {
  const glm::ivec3 low = cellOf(box.lower), high = cellOf(box.upper);
  for (int z = low.z; z <= high.z; ++z)
    for (int y = low.y; y <= high.y; ++y)
      for (int x = low.x; x <= high.x; ++x) visit(cellNumber({x, y, z}));
}

void SelfCrossings::putInCells(const glm::ivec3& lower, const glm::ivec3& upper) {
  constexpr int kMostCells = 48;
  const glm::ivec3 extent = upper - lower;
  origin_ = lower;
  cells_ = std::clamp(static_cast<int>(std::sqrt(static_cast<double>(boxes_.size()) / 4)), 1,
                      kMostCells);
  cell_size_ = std::max({extent.x, extent.y, extent.z}) / cells_ + 1;
  first_.assign(static_cast<std::size_t>(cells_) * static_cast<std::size_t>(cells_) *
                        static_cast<std::size_t>(cells_) +
                    1,
                0);
  for (const Box& box : boxes_) forEachCellOf(box, [&](std::size_t cell) { ++first_[cell]; });
  std::uint32_t sum = 0;
  for (std::uint32_t& first : first_) first = sum += first;
  in_cells_.resize(sum);
  for (auto t = static_cast<std::uint32_t>(boxes_.size()); t-- > 0;)
    forEachCellOf(boxes_[t], [&](std::size_t cell) { in_cells_[--first_[cell]] = t; });
}

std::span<const std::uint32_t> SelfCrossings::find(std::span<const glm::ivec3> positions,
                                                   std::span<const Triangle> triangles) {
  found_.clear();
  boxes_.clear();
  if (triangles.empty()) return found_;
  glm::ivec3 lower(kMostCoordinate), upper(-kMostCoordinate);
  for (const auto& [a, b, c] : triangles) {
    boxes_.push_back({glm::min(glm::min(positions[a], positions[b]), positions[c]),
                      glm::max(glm::max(positions[a], positions[b]), positions[c])});
    lower = glm::min(lower, boxes_.back().lower);
    upper = glm::max(upper, boxes_.back().upper);
  }
  putInCells(lower, upper);
  const auto pointsOf = [&](const Triangle& triangle) {
    return std::array<Point, 3>{Point(positions[triangle[0]]), Point(positions[triangle[1]]),
                                Point(positions[triangle[2]])};
  };
  for (std::uint32_t t = 0; t < triangles.size(); ++t)
    if (const auto [a, b, c] = pointsOf(triangles[t]); Projection::of(a, b, c).u < 0)
      found_.push_back(t);
  const std::size_t without_area = found_.size();
  const auto hasArea = [&](std::uint32_t t) {
    return without_area == 0 ||
           !std::binary_search(found_.begin(),
                               found_.begin() + static_cast<std::ptrdiff_t>(without_area), t);
  };
  const auto check = [&](std::uint32_t t, std::uint32_t other) {
    Triangle a = triangles[t], b = triangles[other];
    const std::size_t shared = alignShared(a, b);
    if (hasArea(t) && hasArea(other) && doCross(pointsOf(a), pointsOf(b), shared))
      found_.insert(found_.end(), {t, other});
  };
  for (std::size_t cell = 0; cell + 1 < first_.size(); ++cell) {
    const auto here = std::span(in_cells_).subspan(first_[cell], first_[cell + 1] - first_[cell]);
    for (std::size_t i = 0; i < here.size(); ++i)
      for (std::size_t j = i + 1; j < here.size(); ++j) {
        const Box &a = boxes_[here[i]], &b = boxes_[here[j]];
        const glm::ivec3 low = glm::max(a.lower, b.lower), high = glm::min(a.upper, b.upper);
        // In the first of the cells that have both.
        if (low.x <= high.x && low.y <= high.y && low.z <= high.z &&
            cellNumber(cellOf(low)) == cell)
          check(here[i], here[j]);
      }
  }
  std::sort(found_.begin(), found_.end());
  found_.erase(std::unique(found_.begin(), found_.end()), found_.end());
  return found_;
}

}  // namespace isobrick
