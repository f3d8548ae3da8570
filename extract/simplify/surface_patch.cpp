#include "isobrick/extract/simplify/surface_patch.h"

#include <cmath>
#include <glm/geometric.hpp>

namespace isobrick {
namespace {

glm::vec3 unitOrZero(const glm::vec3& v) {
  const float length = glm::length(v);
  return length > 0 ? v / length : glm::vec3(0.0f);
}

int next(int side) { return side == 2 ? 0 : side + 1; }

}  // namespace

void SurfacePatch::set(std::span<const std::uint32_t> triangles, std::size_t positions) {
  triangles_.assign(triangles.begin(), triangles.end());
  first_around_.assign(positions + 2, 0);
  for (const std::uint32_t vertex : triangles_) ++first_around_[vertex + 2];
  for (std::size_t v = 2; v < first_around_.size(); ++v) first_around_[v] += first_around_[v - 1];
  around_.resize(triangles_.size());
  for (std::size_t i = 0; i < triangles_.size(); ++i)
    around_[first_around_[triangles_[i] + 1]++] = static_cast<std::uint32_t>(i / 3);
  first_around_.pop_back();
  findNeighbours();
  findPinches();
}

bool SurfacePatch::hasSide(std::uint32_t a, std::uint32_t b) const {
  for (const std::uint32_t t : around(a))
    for (int c = 0; c < 3; ++c)
      if (triangle(t)[c] == b) return true;
  return false;
}

bool SurfacePatch::hasTriangle(const std::uint32_t* corners) const {
  for (const std::uint32_t t : around(corners[0])) {
    int first = 0;
    while (triangle(t)[first] != corners[0]) ++first;
    if (triangle(t)[next(first)] == corners[1] && triangle(t)[next(next(first))] == corners[2])
      return true;
  }
  return false;
}

void SurfacePatch::findNeighbours() {
  beside_.assign(triangles_.size(), kNone);
  faults_.clear();
  for (std::uint32_t t = 0; t < count(); ++t) {
    const std::uint32_t* const own = triangle(t);
    for (int side = 0; side < 3; ++side) {
      const std::uint32_t from = own[side], to = own[next(side)];
      std::uint32_t same = 0, opposite = 0, found = kNone;
      for (const std::uint32_t other : around(from)) {
        const std::uint32_t* const theirs = triangle(other);
        for (int s = 0; s < 3; ++s) {
          if (theirs[s] == from && theirs[next(s)] == to) ++same;
          if (theirs[s] != to || theirs[next(s)] != from) continue;
          ++opposite;
          found = other;
          const std::uint32_t own_third = own[next(next(side))];
          if (theirs[next(next(s))] == own_third) ++same;  // back to back
        }
      }
      if (same == 1 && opposite <= 1)
        beside_[std::size_t{3} * t + static_cast<std::size_t>(side)] = found;
      else
        faults_.insert(faults_.end(), {from, to});
    }
  }
}

// Triangles around a vertex that is no fault are one fan, open or closed.
void SurfacePatch::findPinches() {
  const auto cornerOf = [this](std::uint32_t t, std::uint32_t vertex) {
    const std::uint32_t* const corners = triangle(t);
    return corners[0] == vertex ? 0 : corners[1] == vertex ? 1 : 2;
  };
  for (std::uint32_t v = 0; v + 1 < first_around_.size(); ++v) {
    const std::size_t all = around(v).size();
    if (all < 2) continue;
    const std::uint32_t first = around(v)[0];
    std::size_t seen = 1;
    std::uint32_t t = beside(first, cornerOf(first, v));
    for (; t != kNone && t != first && seen <= all; t = beside(t, cornerOf(t, v))) ++seen;
    if (t == kNone) {
      t = beside(first, (cornerOf(first, v) + 2) % 3);
      for (; t != kNone && seen <= all; t = beside(t, (cornerOf(t, v) + 2) % 3)) ++seen;
    }
    if (seen != all) faults_.push_back(v);
  }
}

void SurfacePatch::place(std::span<const glm::vec3> positions) {
  facets_.resize(count());
  for (std::uint32_t t = 0; t < count(); ++t) {
    Facet& facet = facets_[t];
    for (std::size_t c = 0; c < 3; ++c) facet.corners[c] = positions[triangle(t)[c]];
    const auto& [a, b, c] = facet.corners;
    facet.normal = unitOrZero(glm::cross(b - a, c - a));
  }
  for (std::uint32_t t = 0; t < count(); ++t) {
    Facet& facet = facets_[t];
    for (int side = 0; side < 3; ++side) {
      Plane& plane = facet.sides[static_cast<std::size_t>(side)];
      plane = Plane();
      const std::uint32_t other = beside(t, side);
      if (other == kNone) continue;
      // The same on both sides, to the bit: the edge's ends in one order.
      const glm::vec3 mean = facet.normal + facets_[other].normal;
      const glm::vec3& from = facet.corners[static_cast<std::size_t>(side)];
      const glm::vec3& to = facet.corners[static_cast<std::size_t>(next(side))];
      plane.normal = unitOrZero(glm::cross(to - from, mean));
      plane.offset = glm::dot(plane.normal, from);
    }
  }
}

}  // namespace isobrick
