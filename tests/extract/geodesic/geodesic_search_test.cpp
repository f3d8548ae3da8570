// Shortest paths over meshes: against a slow search with many points on every edge, and against
// shapes whose paths are known.
#include "isobrick/extract/geodesic/geodesic_search.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <queue>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/nearest_on_triangle.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {
namespace {

struct SearchMesh {
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> triangles;

  std::array<glm::dvec3, 3> corners(std::uint32_t triangle) const {
    return {positions[triangles[3 * triangle]], positions[triangles[3 * triangle + 1]],
            positions[triangles[3 * triangle + 2]]};
  }
  std::uint32_t count() const { return static_cast<std::uint32_t>(triangles.size() / 3); }
};

// Some balls in a small volume: closed, or cut by its border, in one piece or several.
SearchMesh randomSurface(Random& random) {
  const TemporaryFolder folder;
  std::vector<std::pair<glm::dvec3, double>> balls(5);
  for (auto& [center, radius] : balls) {
    for (int axis = 0; axis < 3; ++axis) center[axis] = randomReal(random, 0.0, 10.0);
    radius = randomReal(random, 1.5, 4.0);
  }
  BuildOptions build;
  build.brick_cells = 16;
  GridGeometry geometry;
  geometry.spacing = {randomReal(random, 0.5, 1.5), 1.0, randomReal(random, 0.5, 1.5)};
  const Pyramid pyramid(buildField(
      folder, {11, 11, 11},
      [&](const glm::dvec3& p) {
        double sum = 0.3 * randomReal(random, -1.0, 1.0);
        for (const auto& [center, radius] : balls)
          sum += std::exp(-glm::dot(p - center, p - center) / (radius * radius));
        return sum;
      },
      build, geometry));
  IndexedMeshSink sink;
  Query query;
  query.isovalue = 0.7;
  extractIsosurface(pyramid, query, sink);
  return {sink.mesh().positions, sink.mesh().triangles};
}

// Hills and pits over a square, of triangles of all forms.
SearchMesh randomHills(Random& random) {
  constexpr std::uint32_t kSide = 12;
  SearchMesh mesh;
  for (std::uint32_t y = 0; y < kSide; ++y)
    for (std::uint32_t x = 0; x < kSide; ++x)
      mesh.positions.emplace_back(x + randomReal(random, -0.3, 0.3),
                                  y + randomReal(random, -0.3, 0.3), randomReal(random, 0.0, 2.0));
  for (std::uint32_t y = 0; y + 1 < kSide; ++y)
    for (std::uint32_t x = 0; x + 1 < kSide; ++x) {
      const std::uint32_t a = y * kSide + x, b = a + 1, c = a + kSide, d = c + 1;
      for (const std::uint32_t v : {a, b, d, a, d, c}) mesh.triangles.push_back(v);
    }
  return mesh;
}

TrianglePoint randomPoint(const SearchMesh& mesh, Random& random) {
  const auto triangle = static_cast<std::uint32_t>(randomBelow(random, mesh.count()));
  double s = randomReal(random, 0.0, 1.0), t = randomReal(random, 0.0, 1.0);
  if (s + t > 1.0) s = 1.0 - s, t = 1.0 - t;
  const auto [a, b, c] = mesh.corners(triangle);
  switch (randomBelow(random, 8)) {
    case 0:
      return {triangle, a};
    case 1:
      return {triangle, a + s * (b - a)};
    default:
      return {triangle, a + s * (b - a) + t * (c - a)};
  }
}

// Lengths from a point to others by Dijkstra's search, in which all points of a triangle's sides
// are joined by straight lines: an upper bound that comes near.
class ManyPointSearch {
 public:
  explicit ManyPointSearch(const SearchMesh& mesh) : places_(mesh.positions) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> edges;
    of_triangle_.resize(mesh.count());
    for (std::uint32_t t = 0; t < mesh.count(); ++t)
      for (std::uint32_t k = 0; k < 3; ++k) {
        const std::uint32_t a = mesh.triangles[3 * t + k], b = mesh.triangles[3 * t + (k + 1) % 3];
        of_triangle_[t].push_back(a);
        const auto [edge, is_new] = edges.try_emplace({std::min(a, b), std::max(a, b)},
                                                      static_cast<std::uint32_t>(places_.size()));
        for (std::uint32_t i = 0; i < kPoints; ++i) {
          if (is_new)
            places_.push_back(mesh.positions[a] + (i + 1.0) / (kPoints + 1.0) *
                                                      (mesh.positions[b] - mesh.positions[a]));
          of_triangle_[t].push_back(edge->second + i);
        }
      }
    triangles_of_.resize(places_.size());
    for (std::uint32_t t = 0; t < mesh.count(); ++t)
      for (const std::uint32_t place : of_triangle_[t]) triangles_of_[place].push_back(t);
  }

  void searchFrom(const TrianglePoint& from) {
    lengths_.assign(places_.size(), std::numeric_limits<double>::infinity());
    using Reached = std::pair<double, std::uint32_t>;
    std::priority_queue<Reached, std::vector<Reached>, std::greater<>> queue;
    const auto reach = [&](std::uint32_t place, double length) {
      if (length >= lengths_[place]) return;
      lengths_[place] = length;
      queue.push({length, place});
    };
    for (const std::uint32_t place : of_triangle_[from.triangle])
      reach(place, glm::distance(places_[place], from.place));
    while (!queue.empty()) {
      const auto [length, at] = queue.top();
      queue.pop();
      if (length > lengths_[at]) continue;
      for (const std::uint32_t triangle : triangles_of_[at])
        for (const std::uint32_t place : of_triangle_[triangle])
          reach(place, length + glm::distance(places_[at], places_[place]));
    }
    from_ = from;
  }
  double lengthTo(const TrianglePoint& to) const {
    if (to.triangle == from_.triangle) return glm::distance(from_.place, to.place);
    double best = std::numeric_limits<double>::infinity();
    for (const std::uint32_t place : of_triangle_[to.triangle])
      best = std::min(best, lengths_[place] + glm::distance(places_[place], to.place));
    return best;
  }

 private:
  static constexpr std::uint32_t kPoints = 10;
  std::vector<glm::dvec3> places_;
  std::vector<std::vector<std::uint32_t>> of_triangle_, triangles_of_;
  std::vector<double> lengths_;
  TrianglePoint from_;
};

// Each step of the path lies in one triangle: both of its ends, and so all of it, do.
void expectOnSurface(const SearchMesh& mesh, const GeodesicPath& path) {
  double sum = 0.0;
  for (std::size_t i = 1; i < path.points.size(); ++i) {
    const glm::dvec3 &a = path.points[i - 1], &b = path.points[i];
    sum += glm::distance(a, b);
    double off = std::numeric_limits<double>::infinity();
    for (std::uint32_t t = 0; t < mesh.count(); ++t) {
      const auto [p, q, r] = mesh.corners(t);
      off = std::min(off, std::max(squaredDistance(a, p, q, r), squaredDistance(b, p, q, r)));
    }
    ASSERT_LT(off, 1e-12) << "step " << i << " of " << path.points.size();
  }
  EXPECT_NEAR(path.length, sum, 1e-9);
}

TEST(GeodesicSearchTest, RandomPairsAreThoseOfASlowSearch) {
  Random random(28);
  const int most = repetitions(2000);
  int pairs = 0, apart = 0;
  double slow_sum = 0.0, sum = 0.0;
  for (int round = 0; pairs < most; ++round) {
    const SearchMesh mesh = round % 2 == 0 ? randomSurface(random) : randomHills(random);
    if (mesh.count() == 0) continue;
    const GeodesicSearch search(mesh.positions, mesh.triangles);
    ManyPointSearch slow(mesh);
    for (int i = 0; i < 5; ++i) {
      const TrianglePoint from = randomPoint(mesh, random);
      slow.searchFrom(from);
      for (int j = 0; j < 10; ++j, ++pairs) {
        const TrianglePoint to = randomPoint(mesh, random);
        const double bound = slow.lengthTo(to);
        const double edges = search.lengthAlongEdges(from, to, {});
        const auto path = search.shortestPath(from, to, {});
        const std::string where =
            "round " + std::to_string(round) + ", " + std::to_string(i) + ", " + std::to_string(j);
        if (!std::isfinite(bound)) {
          ++apart;
          ASSERT_FALSE(path) << where;
          ASSERT_FALSE(std::isfinite(edges)) << where;
          continue;
        }
        ASSERT_TRUE(path) << where;
        expectOnSurface(mesh, *path);
        // Both ends are moved by up to 1e-6 of an edge.
        ASSERT_LE(path->length, bound + 1e-5) << where;
        ASSERT_LE(path->length, edges + 1e-5) << where;
        ASSERT_NEAR(search.shortestPath(to, from, {})->length, path->length, 1e-8) << where;
        ASSERT_NEAR(search.shortestPath(from, to, {edges + 1e-5})->length, path->length, 1e-8)
            << where;
        EXPECT_LT(glm::distance(path->points.front(), from.place), 1e-5);
        EXPECT_LT(glm::distance(path->points.back(), to.place), 1e-5);
        slow_sum += bound;
        sum += path->length;
      }
    }
  }
  EXPECT_GT(apart, most / 40);
  // The bound comes near, so it would show a path that is not the shortest one.
  EXPECT_LT(slow_sum, 1.005 * sum);
  EXPECT_GT(slow_sum, sum);
}

// A flat square, with vertices in rows through which lines go exactly.
TEST(GeodesicSearchTest, APlaneHasStraightPaths) {
  constexpr std::uint32_t kSide = 30;
  SearchMesh mesh;
  for (std::uint32_t y = 0; y < kSide; ++y)
    for (std::uint32_t x = 0; x < kSide; ++x) mesh.positions.emplace_back(x, y, 0.5 * x);
  for (std::uint32_t y = 0; y + 1 < kSide; ++y)
    for (std::uint32_t x = 0; x + 1 < kSide; ++x) {
      const std::uint32_t a = y * kSide + x, b = a + 1, c = a + kSide, d = c + 1;
      for (const std::uint32_t v : {a, b, d, a, d, c}) mesh.triangles.push_back(v);
    }
  const GeodesicSearch search(mesh.positions, mesh.triangles);
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const TrianglePoint from = randomPoint(mesh, random), to = randomPoint(mesh, random);
    EXPECT_NEAR(search.shortestPath(from, to, {})->length, glm::distance(from.place, to.place),
                1e-5);
  }
}

// A cube's surface: the shortest way between the middles of two opposite sides is straight over a
// third one, and that from corner to corner is the diagonal of two sides in a plane.
TEST(GeodesicSearchTest, ACubeUnfolds) {
  SearchMesh mesh;
  for (std::uint32_t i = 0; i < 8; ++i) mesh.positions.emplace_back(i & 1, i >> 1 & 1, i >> 2);
  mesh.triangles = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                    2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
  const GeodesicSearch search(mesh.positions, mesh.triangles);
  EXPECT_NEAR(search.shortestPath({0, {0.5, 0.5, 0}}, {2, {0.5, 0.5, 1}}, {})->length, 2.0, 1e-5);
  EXPECT_NEAR(search.shortestPath({0, {0, 0, 0}}, {7, {1, 1, 1}}, {})->length, std::sqrt(5.0),
              1e-5);
  EXPECT_FALSE(search.shortestPath({0, {0, 0, 0}}, {7, {1, 1, 1}}, {2.2}));
}

TEST(GeodesicSearchTest, EndsWhenItMay) {
  Random random(3);
  const SearchMesh mesh = randomHills(random);
  const GeodesicSearch search(mesh.positions, mesh.triangles);
  const TrianglePoint from{0, mesh.positions[0]},
      to{mesh.count() - 1, mesh.positions[mesh.triangles.back()]};
  CancelFlag cancel;
  cancel.request();
  EXPECT_THROW(search.shortestPath(from, to, {.cancel = &cancel}), Cancelled);
  EXPECT_THROW(search.lengthAlongEdges(from, to, {.cancel = &cancel}), Cancelled);
  EXPECT_THROW(search.shortestPath(from, to, {.most_bytes = 1000}), SearchTooLarge);
  std::atomic<float> done = 0.0f;
  const double edges = search.lengthAlongEdges(from, to, {});
  search.shortestPath(from, to, {.longest = edges, .fraction_done = &done});
  EXPECT_LE(done, 1.0f);
}

}  // namespace
}  // namespace isobrick::test
