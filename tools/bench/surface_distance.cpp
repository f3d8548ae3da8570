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

#include "isobrick/extract/sinks/nearest_parts.h"
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
  double distance;
};

// Calls take(position, area) for every vertex and for the centroid of every piece. A triangle is
// cut into n^2 equal pieces: n(n+1)/2 as it stands and n(n-1)/2 the other way round.
template <typename Take>
void forEachPoint(const PlainMesh& mesh, Take take) {
  for (std::uint32_t v = 0; v < mesh.positions.size(); ++v)
    take(glm::dvec3(cornerOf(mesh, v)), 0.0);
  for (const auto& [first, second, third] : mesh.triangles) {
    const glm::dvec3 a = cornerOf(mesh, first);
    glm::dvec3 u = glm::dvec3(cornerOf(mesh, second)) - a;
    glm::dvec3 v = glm::dvec3(cornerOf(mesh, third)) - a;
    const double longest = std::max({glm::length(u), glm::length(v), glm::length(u - v)});
    const double cuts = std::clamp(std::ceil(longest), 1.0, 4096.0);
    u /= cuts;
    v /= cuts;
    const double area = 0.5 * glm::length(glm::cross(u, v));
    const int n = static_cast<int>(cuts);
    for (int i = 0; i < n; ++i)
      for (int j = 0; i + j < n; ++j) {
        const glm::dvec3 corner = a + static_cast<double>(i) * u + static_cast<double>(j) * v;
        take(corner + (u + v) / 3.0, area);
        if (i + j + 1 < n) take(corner + 2.0 * (u + v) / 3.0, area);
      }
  }
}

std::vector<SurfacePoint> chosenPoints(const PlainMesh& mesh, const DistanceOptions& options) {
  std::size_t all = 0, seen = 0;
  forEachPoint(mesh, [&](const glm::dvec3&, double) { ++all; });
  // Odd, as triangles often come in pairs, of which an even step would take only one half.
  const std::size_t stride = ((all + options.most_points - 1) / options.most_points) | 1u;
  const glm::dvec3 lower(1.0), upper(options.voxels - Index3(2));
  std::vector<SurfacePoint> points;
  forEachPoint(mesh, [&](const glm::dvec3& point, double area) {
    if (++seen % stride == 0 && glm::all(glm::greaterThanEqual(point, lower)) &&
        glm::all(glm::lessThanEqual(point, upper)))
      points.push_back({glm::vec3(point), static_cast<float>(area), 0});
  });
  return points;
}

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
  std::vector<SurfacePoint> points = chosenPoints(from, options);
  const TriangleTree tree(to);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 1024), [&](const auto& part) {
    std::uint32_t hint = 0;
    for (std::size_t i = part.begin(); i < part.end(); ++i)
      points[i].distance = tree.distance(glm::dvec3(points[i].position), hint);
  });
  tbb::parallel_sort(points.begin(), points.end(),
                     [](const auto& a, const auto& b) { return a.distance < b.distance; });

  OneWayDistance result;
  result.points = points.size();
  if (points.empty()) return result;
  result.max = points.back().distance;
  double area = 0, moment = 0, below = 0;
  for (const SurfacePoint& point : points) {
    area += point.area;
    if (point.area > 0) moment += point.area * point.distance;
  }
  if (area <= 0) return result;
  result.mean = moment / area;
  result.p99 = std::find_if(points.begin(), points.end(), [&](const SurfacePoint& point) {
                 return (below += point.area) >= 0.99 * area;
               })->distance;
  return result;
}

}  // namespace isobrick
