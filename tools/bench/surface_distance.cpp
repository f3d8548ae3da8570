#include "tools/bench/surface_distance.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <utility>

#include "isobrick/extract/triangle_tree.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

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
    take(glm::dvec3(mesh.positions[v]), 0.0);
  for (const auto& [first, second, third] : mesh.triangles) {
    const glm::dvec3 a = mesh.positions[first];
    glm::dvec3 u = glm::dvec3(mesh.positions[second]) - a;
    glm::dvec3 v = glm::dvec3(mesh.positions[third]) - a;
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
  const TriangleTree tree(to.positions, to.triangles);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 1024), [&](const auto& part) {
    std::uint32_t hint = 0;
    for (std::size_t i = part.begin(); i < part.end(); ++i)
      points[i].distance = std::sqrt(tree.squaredDistance(glm::dvec3(points[i].position), hint));
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
