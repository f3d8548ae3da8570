#include "isobrick/extract/geodesic/surface_path.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "isobrick/extract/geodesic/geodesic_search.h"
#include "isobrick/extract/geodesic/near_surface.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/nearest_on_triangle.h"
#include "isobrick/extract/sinks/surface_components.h"

namespace isobrick {
namespace {

constexpr double kEndReachCells = 4.0;
// The first ellipsoid, in straight distances between the ends.
constexpr double kFirstDetour = 1.5;
// Bytes that a mesh in memory and the search on it take.
constexpr std::uint64_t kBytesPerTriangle = 40;

// One search on one level.
class PathOnLevel {
 public:
  PathOnLevel(Extractor& extractor, const Pyramid& pyramid, const SurfacePathEnds& ends,
              const SurfacePathBounds& bounds, int level)
      : extractor_(extractor), pyramid_(pyramid), ends_(ends), bounds_(bounds), level_(level) {
    const glm::dvec3& spacing = pyramid.spec().geometry.spacing;
    cell_ = std::ldexp(std::max({spacing.x, spacing.y, spacing.z}), level);
  }

  // Throws TooMuchSurface and SearchTooLarge.
  SurfacePath find() {
    double sum = kFirstDetour * glm::distance(ends_.from, ends_.to) + 2 * kEndReachCells * cell_;
    bool is_joined = false;  // the ends lie on one piece
    while (true) {
      const bool is_whole = extractWithin(sum);
      const GeodesicSearch search(mesh_.positions, mesh_.triangles);
      const TrianglePoint from = place(ends_.from, 1), to = place(ends_.to, 2);
      const double along_edges = search.lengthAlongEdges(from, to, {.cancel = bounds_.cancel});
      if (std::isfinite(along_edges) && (along_edges <= sum || is_whole))
        return shortest(search, from, to, along_edges);
      if (!std::isfinite(along_edges) && is_whole) refuse();
      if (!std::isfinite(along_edges) && !is_joined) is_joined = areOnOnePiece();
      sum = std::isfinite(along_edges) ? along_edges : 2.0 * sum;
    }
  }

 private:
  [[noreturn]] static void refuse() {
    throw Error("no path over the surface: the points lie on different pieces of it");
  }

  Query query() const {
    Query query;
    query.isovalue = ends_.isovalue;
    query.uniform_level = level_;
    query.cancel = bounds_.cancel;
    query.fraction_done = bounds_.fraction_done;
    if (bounds_.fraction_done != nullptr) *bounds_.fraction_done = 0.0f;
    return query;
  }

  // True if that is the whole surface.
  bool extractWithin(double sum) {
    const Ellipsoid ellipsoid{ends_.from, ends_.to, sum};
    Query near = query();
    near.box = ellipsoid.box(pyramid_.spec().geometry);
    IndexedMeshSink sink;
    NearSurface filter(
        ellipsoid, bounds_.most_bytes / (kBytesPerTriangle + GeodesicSearch::bytesFor(1)), sink);
    extractor_.extract(near, filter);
    mesh_ = sink.takeMesh();
    // The ellipsoid holds a ball of this radius around the middle between the ends.
    const double between = glm::distance(ends_.from, ends_.to);
    const double radius = 0.5 * std::sqrt(std::max(0.0, sum * sum - between * between));
    const glm::dvec3 middle = 0.5 * (ends_.from + ends_.to);
    double furthest = 0.0;
    for (const glm::dvec3& corner : worldCorners(pyramid_.spec().geometry, pyramid_.spec().voxels))
      furthest = std::max(furthest, glm::distance(middle, corner));
    return radius >= furthest;
  }

  TrianglePoint place(const glm::dvec3& point, int number) const {
    TrianglePoint nearest;
    double least = kEndReachCells * cell_;
    bool found = false;
    for (std::size_t i = 0; i < mesh_.triangles.size(); i += 3) {
      const glm::dvec3& a = mesh_.positions[mesh_.triangles[i]];
      // Cheaper than the exact distance: all of a triangle lies within two cells of its corner.
      if (glm::distance(a, point) > least + 2.0 * cell_) continue;
      const glm::dvec3 there = nearestOnTriangle(point, a, mesh_.positions[mesh_.triangles[i + 1]],
                                                 mesh_.positions[mesh_.triangles[i + 2]]);
      const double distance = glm::distance(there, point);
      if (distance > least || (found && distance == least)) continue;
      least = distance;
      found = true;
      nearest = {static_cast<std::uint32_t>(i / 3), there};
    }
    if (!found)
      throw Error("no path over the surface: point " + std::to_string(number) +
                  " is not on the surface of this isovalue");
    return nearest;
  }

  // Throws if they are not.
  bool areOnOnePiece() {
    ComponentPoints points;
    points.points = {ends_.from, ends_.to};
    points.reach = kEndReachCells;
    const Query whole = query();
    ComponentFinder finder(whole, std::move(points));
    extractor_.extract(whole, finder);
    const SurfaceComponents components = finder.take();
    if (components.atPoints()[0] != components.atPoints()[1]) refuse();
    return true;
  }

  SurfacePath shortest(const GeodesicSearch& search, const TrianglePoint& from,
                       const TrianglePoint& to, double along_edges) {
    GeodesicBounds bounds;
    bounds.longest = along_edges * (1.0 + 1e-9) + 1e-5 * cell_;
    const std::uint64_t mesh_bytes =
        mesh_.triangles.size() / 3 * (kBytesPerTriangle + GeodesicSearch::bytesFor(1));
    bounds.most_bytes = bounds_.most_bytes - std::min(bounds_.most_bytes, mesh_bytes);
    bounds.cancel = bounds_.cancel;
    bounds.fraction_done = bounds_.fraction_done;
    if (bounds.fraction_done != nullptr) *bounds.fraction_done = 0.0f;
    std::optional<GeodesicPath> path = search.shortestPath(from, to, bounds);
    if (!path) refuse();  // along edges there is one
    SurfacePath result;
    result.points = std::move(path->points);
    for (const auto& [a, b] : path->beside)
      result.outwards.push_back(glm::normalize(mesh_.normals[a] + mesh_.normals[b]));
    result.length = path->length;
    result.level = level_;
    return result;
  }

  Extractor& extractor_;
  const Pyramid& pyramid_;
  const SurfacePathEnds& ends_;
  const SurfacePathBounds& bounds_;
  const int level_;
  double cell_ = 1.0;  // its longest edge, world units
  IndexedMesh mesh_;
};

}  // namespace

SurfacePath findSurfacePath(Extractor& extractor, const Pyramid& pyramid,
                            const SurfacePathEnds& ends, const SurfacePathBounds& bounds) {
  for (int level = 0; level < pyramid.lattice().levels(); ++level) {
    try {
      return PathOnLevel(extractor, pyramid, ends, bounds, level).find();
    } catch (const TooMuchSurface&) {
    } catch (const SearchTooLarge&) {
    }
  }
  throw Error("no path over the surface: it takes more memory than " +
              std::to_string(bounds.most_bytes >> 20) + " MiB");
}

}  // namespace isobrick
