// The shortest path over triangles from one point to another, exact.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "isobrick/extract/simplify/corner_table.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// A point of a mesh.
struct TrianglePoint {
  std::uint32_t triangle = 0;
  glm::dvec3 place{0.0};  // in the triangle
};

struct GeodesicBounds {
  // Longer paths do not count; how long a known one is makes the search faster.
  double longest = std::numeric_limits<double>::infinity();
  std::uint64_t most_bytes = std::numeric_limits<std::uint64_t>::max();  // of the search
  const CancelFlag* cancel = nullptr;
  // Raised to the share of the way that is certain. May be null.
  std::atomic<float>* fraction_done = nullptr;
};

// The search, or what it works on, needs more bytes than it may.
struct SearchTooLarge {};

struct GeodesicPath {
  std::vector<glm::dvec3> points;  // from one point to the other, straight within each triangle
  // Two vertices of the mesh that each lies between; at an end, those of the next point.
  std::vector<std::array<std::uint32_t, 2>> beside;
  double length = 0.0;
};

// Shortest paths over a mesh by windows (Mitchell, Mount and Papadimitriou, 1987; Chen and Han,
// 1990, with the order and the tests of Xin and Wang, 2009). The shortest path is straight in the
// triangles that it crosses, if these are unfolded into a plane, and bends at vertices only around
// which there is more than a full turn. A window is a part of an edge together with the point, in
// that plane, from which straight lines come to it; crossing a triangle, it makes a window or two
// of it. A window is dropped only if another path is certainly shorter at each of its points.
// Windows come in the order of the least length that a path through them to the goal may have, so
// the search sees little beyond the points that such a path may have.
//
// Exact for the mesh up to rounding: its path is one over the triangles, and no other one is
// shorter by more than a relative 1e-9, and 1e-6 of an edge at both ends.
class GeodesicSearch {
 public:
  // The mesh outlives it. Triangles: three vertices each, none of them without area.
  GeodesicSearch(std::span<const glm::dvec3> positions, std::span<const std::uint32_t> triangles);

  // Along edges alone; infinity if there is no path. An upper bound, some percent above the path's.
  double lengthAlongEdges(const TrianglePoint& from, const TrianglePoint& to,
                          const GeodesicBounds& bounds) const;
  // None if there is no path within the bounds. Throws Cancelled and SearchTooLarge.
  std::optional<GeodesicPath> shortestPath(const TrianglePoint& from, const TrianglePoint& to,
                                           const GeodesicBounds& bounds) const;

  // Bytes for so many triangles, without windows.
  static std::uint64_t bytesFor(std::uint64_t triangles) { return 180 * triangles; }

 private:
  friend class WindowSearch;

  std::span<const glm::dvec3> positions_;
  std::span<const std::uint32_t> triangles_;
  CornerTable corners_;
  std::vector<std::uint8_t> may_bend_;  // of a vertex: a shortest path may have a corner there
};

}  // namespace isobrick
