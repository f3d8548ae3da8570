// The shortest way over an isosurface from one point to another.
#pragma once

#include <atomic>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The points on the surface that a path begins and ends at.
struct SurfacePathEnds {
  double isovalue = 0.0;
  glm::dvec3 from{0.0}, to{0.0};  // world units, at most 4 cells off the surface
};

struct SurfacePath {
  std::vector<glm::dvec3> points;   // world units, from one end to the other
  std::vector<glm::vec3> outwards;  // unit, towards lower values, at each of them
  double length = 0.0;              // world units
  int level = 0;                    // of the pyramid; above 0: level 0 would take too much memory
};

struct SurfacePathBounds {
  // The most bytes of triangles and search. If level 0 takes more, coarser levels are tried.
  std::uint64_t most_bytes = std::uint64_t{1} << 30;
  const CancelFlag* cancel = nullptr;           // may be null
  std::atomic<float>* fraction_done = nullptr;  // of what is under way; may be null
};

// The shortest path over the triangles of a level (GeodesicSearch). No path that is as short as a
// known one leaves the ellipsoid of points from which the ends are together no further than its
// length, so that only the bricks at such an ellipsoid are extracted, first a small one.
//
// Throws Error if an end is not at the surface, if the ends lie on different pieces of it, and if
// no level fits the memory; and Cancelled.
SurfacePath findSurfacePath(Extractor& extractor, const Pyramid& pyramid,
                            const SurfacePathEnds& ends, const SurfacePathBounds& bounds);

}  // namespace isobrick
