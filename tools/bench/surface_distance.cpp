#include "tools/bench/surface_distance.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <numeric>
#include <span>
#include <utility>

#include "isobrick/extract/sinks/nearest_on_triangle.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

glm::vec3 cornerOf(const PlainMesh& mesh, std::uint32_t vertex) {
  const auto& [x, y, z] = mesh.positions[vertex];
  return {x, y, z};
}

// Boxes around halves of the triangles, halves of these, and so on. Refers to the mesh.
class TriangleTree {
 public:
  explicit TriangleTree(const PlainMesh& mesh) : mesh_(mesh), order_(mesh.triangles.size()) {
    std::iota(order_.begin(), order_.end(), 0u);
    std::size_t leaves = 1;
    while (leaves * kLeafTriangles < order_.size()) leaves *= 2;
    boxes_.resize(2 * leaves);
    if (!order_.empty()) build(1, order_);
  }

  // Infinite without triangles. `hint` is a triangle, and becomes the nearest one: near points have
  // near results.
  double distance(const glm::dvec3& point, std::uint32_t& hint) const {
    if (order_.empty()) return kInfinity;
    double nearest = squaredTo(point, hint);
    search(1, order_, point, nearest, hint);
    return std::sqrt(nearest);
  }

 private:
  static constexpr std::size_t kLeafTriangles = 4;
  static constexpr std::size_t kParallelTriangles = 4096;
  struct Box {
    glm::vec3 lower{std::numeric_limits<float>::infinity()};
    glm::vec3 upper{-std::numeric_limits<float>::infinity()};
  };

  // The children of a node are 2n and 2n + 1.
  void build(std::size_t node, std::span<std::uint32_t> triangles) {
    Box& box = boxes_[node];
    for (const std::uint32_t triangle : triangles)
      for (const std::uint32_t vertex : mesh_.triangles[triangle]) {
        box.lower = glm::min(box.lower, cornerOf(mesh_, vertex));
        box.upper = glm::max(box.upper, cornerOf(mesh_, vertex));
      }
    if (triangles.size() <= kLeafTriangles) return;
    const glm::vec3 size = box.upper - box.lower;
    const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
    const std::size_t half = triangles.size() / 2;
    const auto place = [&](std::uint32_t triangle) {
      const auto& [a, b, c] = mesh_.triangles[triangle];
      return cornerOf(mesh_, a)[axis] + cornerOf(mesh_, b)[axis] + cornerOf(mesh_, c)[axis];
    };
    std::nth_element(triangles.begin(), triangles.begin() + static_cast<std::ptrdiff_t>(half),
                     triangles.end(), [&](auto a, auto b) { return place(a) < place(b); });
    const auto first = [&] { build(2 * node, triangles.first(half)); };
    const auto second = [&] { build(2 * node + 1, triangles.subspan(half)); };
    if (triangles.size() > kParallelTriangles) {
      tbb::parallel_invoke(first, second);
    } else {
      first();
      second();
    }
  }

  double squaredTo(const glm::dvec3& point, std::uint32_t triangle) const {
    const auto& [a, b, c] = mesh_.triangles[triangle];
    return squaredDistance(point, cornerOf(mesh_, a), cornerOf(mesh_, b), cornerOf(mesh_, c));
  }
  double squaredToBox(const glm::dvec3& point, std::size_t node) const {
    const Box& box = boxes_[node];
    const glm::dvec3 outside = glm::max(
        glm::max(glm::dvec3(box.lower) - point, point - glm::dvec3(box.upper)), glm::dvec3(0));
    return glm::dot(outside, outside);
  }

  void search(std::size_t node, std::span<const std::uint32_t> triangles, const glm::dvec3& point,
              double& nearest, std::uint32_t& hint) const {
    if (triangles.size() <= kLeafTriangles) {
      for (const std::uint32_t triangle : triangles)
        if (const double squared = squaredTo(point, triangle); squared < nearest) {
          nearest = squared;
          hint = triangle;
        }
      return;
    }
    const std::size_t half = triangles.size() / 2;
    const double first = squaredToBox(point, 2 * node), second = squaredToBox(point, 2 * node + 1);
    for (const bool is_first : {first <= second, first > second})
      if ((is_first ? first : second) < nearest)
        search(is_first ? 2 * node : 2 * node + 1,
               is_first ? triangles.first(half) : triangles.subspan(half), point, nearest, hint);
  }

  const PlainMesh& mesh_;
  std::vector<std::uint32_t> order_;
  std::vector<Box> boxes_;
};

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

constexpr std::uint64_t kBytesEach = 12;  // of a position, and of a triangle

}  // namespace

void writePlainMesh(const PlainMesh& mesh, const std::string& path) {
  std::ofstream file(path, std::ios::binary);
  const auto write = [&](const void* bytes, std::size_t count) {
    file.write(static_cast<const char*>(bytes), static_cast<std::streamsize>(count));
  };
  const std::uint64_t counts[2] = {mesh.positions.size(), mesh.triangles.size()};
  write(counts, sizeof counts);
  write(mesh.positions.data(), kBytesEach * counts[0]);
  write(mesh.triangles.data(), kBytesEach * counts[1]);
  file.close();
  if (!file)
    throw Error(fmt::format("cannot write '{}': {}; set TMPDIR to a folder with more room", path,
                            std::strerror(errno)));
}

PlainMesh readPlainMesh(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const auto read = [&](void* bytes, std::size_t count) {
    file.read(static_cast<char*>(bytes), static_cast<std::streamsize>(count));
  };
  const auto require = [&](bool holds, const char* why) {
    if (!holds) throw Error(fmt::format("cannot read the mesh '{}': {}", path, why));
  };
  std::uint64_t counts[2] = {0, 0};
  read(counts, sizeof counts);
  require(bool(file), "it is not there, or shorter than its header");
  const std::uint64_t bytes = fileBytes(path), most = bytes / kBytesEach;
  require(counts[0] <= most && counts[1] <= most &&
              sizeof counts + kBytesEach * (counts[0] + counts[1]) == bytes,
          "its size is not that of what it says to hold");
  PlainMesh mesh;
  mesh.positions.resize(counts[0]);
  mesh.triangles.resize(counts[1]);
  read(mesh.positions.data(), kBytesEach * counts[0]);
  read(mesh.triangles.data(), kBytesEach * counts[1]);
  require(bool(file), "it is shorter than it says");
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t vertex : triangle)
      require(vertex < counts[0], "a triangle has a vertex that is not there");
  return mesh;
}

OneWayDistance distanceFrom(const PlainMesh& from, const PlainMesh& to,
                            const DistanceOptions& options) {
  const std::vector<SurfacePoint> points = PointPicker(from, options).points();
  const TriangleTree tree(to);
  std::vector<MeasuredPoint> measured(points.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 1024), [&](const auto& part) {
    std::uint32_t hint = 0;
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
