// The parts of a surface that points are nearest to, found while its batches come by.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <mutex>
#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// The point of the triangle that is nearest. The triangle a, b, c may be a line or a point
// (Ericson, Real-Time Collision Detection, 2005, 5.1.5: by the region of the triangle's plane that
// the point lies over).
glm::dvec3 nearestOnTriangle(const glm::dvec3& point, const glm::dvec3& a, const glm::dvec3& b,
                             const glm::dvec3& c);
// The square of the distance from it.
double squaredDistance(const glm::dvec3& point, const glm::dvec3& a, const glm::dvec3& b,
                       const glm::dvec3& c);

// Thread-safe. The result does not depend on the order of the batches.
class NearestParts {
 public:
  struct Nearest {
    double squared_distance = std::numeric_limits<double>::infinity();
    std::uint64_t part = 0;  // if the distance is finite
  };

  // `reach`: the greatest distance that counts, in edges of cells of the triangle's level, of
  // which `cell_edge` is the longest one of level 0, in the units of the points.
  NearestParts(std::vector<glm::dvec3> points, double reach, double cell_edge);

  // A batch with the positions of its vertices in the units of the points, and the parts that they
  // belong to, counted from `first_part`.
  void add(const MeshBatch& batch, const std::vector<glm::dvec3>& positions,
           const std::vector<std::uint32_t>& parts, std::uint64_t first_part);
  // One a point.
  const std::vector<Nearest>& nearest() const { return nearest_; }

 private:
  const std::vector<glm::dvec3> points_;
  const double reach_;  // of level 0
  std::mutex mutex_;
  std::vector<Nearest> nearest_;
};

}  // namespace isobrick
