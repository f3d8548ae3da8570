#include "tools/bench/surface_distance.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>
#include <vector>

#include "tools/bench/triangle_tree.h"

namespace isobrick {
namespace {

struct SurfacePoint {
  glm::vec3 position;
  float area;  // 0: a vertex
};

struct TriangleCorners {
  glm::dvec3 a, b, c;

  double area() const { return 0.5 * glm::length(glm::cross(b - a, c - a)); }
  // Into how many parts every edge is cut so that no part is longer than a voxel.
  std::int64_t cuts() const {
    const double longest = std::max({glm::length(b - a), glm::length(c - b), glm::length(a - c)});
    return std::clamp(static_cast<std::int64_t>(std::ceil(longest)), std::int64_t{1},
                      std::int64_t{4096});
  }
};

class PointPicker {
 public:
  PointPicker(const PlainMesh& mesh, const DistanceOptions& options)
      : mesh_(mesh), lower_(1.0), upper_(options.voxels - Index3(2)) {
    std::size_t all = mesh.positions.size();
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      const std::int64_t cuts = triangle(t).cuts();
      all += static_cast<std::size_t>(cuts * cuts);
    }
    // Odd, as triangles often come in pairs, of which an even step would take only one half.
    stride_ = ((all + options.most_points - 1) / options.most_points) | 1u;
  }

  std::vector<SurfacePoint> points() {
    for (std::uint32_t v = 0; v < mesh_.positions.size(); ++v) take(cornerOf(mesh_, v), 0);
    for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t) takePieces(triangle(t));
    return std::move(points_);
  }

 private:
  TriangleCorners triangle(std::uint32_t number) const {
    const auto& [a, b, c] = mesh_.triangles[number];
    return {cornerOf(mesh_, a), cornerOf(mesh_, b), cornerOf(mesh_, c)};
  }

  void take(const glm::dvec3& point, double area) {
    if (++seen_ % stride_ != 0) return;
    if (glm::any(glm::lessThan(point, lower_)) || glm::any(glm::greaterThan(point, upper_))) return;
    points_.push_back({glm::vec3(point), static_cast<float>(area)});
  }

  // A triangle cut into n^2 equal ones: n(n+1)/2 as it stands and n(n-1)/2 the other way round.
  void takePieces(const TriangleCorners& triangle) {
    const std::int64_t n = triangle.cuts();
    const glm::dvec3 u = (triangle.b - triangle.a) / static_cast<double>(n);
    const glm::dvec3 v = (triangle.c - triangle.a) / static_cast<double>(n);
    const double area = triangle.area() / static_cast<double>(n * n);
    for (std::int64_t i = 0; i < n; ++i)
      for (std::int64_t j = 0; i + j < n; ++j) {
        const glm::dvec3 corner =
            triangle.a + static_cast<double>(i) * u + static_cast<double>(j) * v;
        take(corner + (u + v) / 3.0, area);
        if (i + j + 1 < n) take(corner + 2.0 * (u + v) / 3.0, area);
      }
  }

  const PlainMesh& mesh_;
  const glm::dvec3 lower_, upper_;
  std::size_t stride_ = 1, seen_ = 0;
  std::vector<SurfacePoint> points_;
};

struct MeasuredPoint {
  double distance;
  double area;
};

}  // namespace

OneWayDistance distanceFrom(const PlainMesh& from, const PlainMesh& to,
                            const DistanceOptions& options) {
  const std::vector<SurfacePoint> points = PointPicker(from, options).points();
  const TriangleTree tree(to);
  std::vector<MeasuredPoint> measured(points.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 1024), [&](const auto& part) {
    TriangleTree::Hint hint;
    for (std::size_t i = part.begin(); i < part.end(); ++i)
      measured[i] = {tree.distance(glm::dvec3(points[i].position), hint),
                     static_cast<double>(points[i].area)};
  });
  tbb::parallel_sort(measured.begin(), measured.end(),
                     [](const auto& a, const auto& b) { return a.distance < b.distance; });

  OneWayDistance result;
  result.points = measured.size();
  if (measured.empty()) return result;
  result.max = measured.back().distance;
  double area = 0, moment = 0;
  for (const MeasuredPoint& point : measured) {
    area += point.area;
    if (point.area > 0) moment += point.area * point.distance;
  }
  if (area <= 0) return result;
  result.mean = moment / area;
  double below = 0;
  for (const MeasuredPoint& point : measured) {
    below += point.area;
    if (below < 0.99 * area) continue;
    result.p99 = point.distance;
    break;
  }
  return result;
}

}  // namespace isobrick
