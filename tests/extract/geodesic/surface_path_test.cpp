// Paths over surfaces of volumes, where their lengths are known.
#include "isobrick/extract/geodesic/surface_path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "isobrick/extract/geodesic/near_surface.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {
namespace {

class SurfacePathTest : public ::testing::Test {
 protected:
  // Bricks cut all surfaces, and the world's origin is far away.
  void build(const Index3& voxels, const Field& field,
             const glm::dvec3& spacing = glm::dvec3(1.0)) {
    BuildOptions options;
    options.brick_cells = 16;
    geometry_.spacing = spacing;
    geometry_.origin = {1000.0, -2000.0, 500.0};
    pyramid_.emplace(buildField(folder_, voxels, field, options, geometry_));
  }
  glm::dvec3 world(const glm::dvec3& index) const { return geometry_.indexToWorld(index); }
  SurfacePath path(const glm::dvec3& from, const glm::dvec3& to, double isovalue = 0.0,
                   std::uint64_t most_bytes = std::uint64_t{1} << 30) {
    Extractor extractor(*pyramid_);
    SurfacePath found = findSurfacePath(extractor, *pyramid_, {isovalue, from, to}, {most_bytes});
    double sum = 0.0;
    for (std::size_t i = 1; i < found.points.size(); ++i)
      sum += glm::distance(found.points[i - 1], found.points[i]);
    EXPECT_NEAR(sum, found.length, 1e-9 * found.length);
    EXPECT_EQ(found.outwards.size(), found.points.size());
    return found;
  }
  std::string refusal(const glm::dvec3& from, const glm::dvec3& to, double isovalue = 0.0) {
    try {
      path(from, to, isovalue);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  const TemporaryFolder folder_;
  GridGeometry geometry_;
  std::optional<Pyramid> pyramid_;
};

glm::dvec3 randomDirection(Random& random) {
  glm::dvec3 direction;
  do {
    for (int axis = 0; axis < 3; ++axis) direction[axis] = randomReal(random, -1.0, 1.0);
  } while (glm::length(direction) > 1.0 || glm::length(direction) < 0.1);
  return glm::normalize(direction);
}

TEST_F(SurfacePathTest, OnASphereItIsTheGreatCircle) {
  constexpr double kRadius = 40.0;
  const glm::dvec3 center(45.3, 46.1, 44.7);
  build(Index3(92), [&](const glm::dvec3& p) { return kRadius - glm::distance(p, center); });
  Random random(5);
  for (int i = 0; i < repetitions(12); ++i) {
    const glm::dvec3 a = randomDirection(random);
    const glm::dvec3 b = i == 0   ? -a
                         : i == 1 ? glm::normalize(a + 0.01 * randomDirection(random))
                                  : randomDirection(random);
    const SurfacePath found = path(world(center + kRadius * a), world(center + kRadius * b));
    const double angle = std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
    EXPECT_NEAR(found.length, kRadius * angle, 0.003 * kRadius * angle) << i;
    EXPECT_EQ(found.level, 0);
    for (std::size_t k = 0; k < found.points.size(); ++k) {
      const glm::dvec3 out = geometry_.worldToIndex(found.points[k]) - center;
      EXPECT_NEAR(glm::length(out), kRadius, 0.05);
      EXPECT_GT(glm::dot(glm::dvec3(found.outwards[k]), glm::normalize(out)), 0.9);
    }
  }
}

TEST_F(SurfacePathTest, SpacingIsThatOfTheWorld) {
  // A ball of the world, in voxels of 1 x 0.5 x 2.
  const glm::dvec3 spacing(1.0, 0.5, 2.0), center(24.2, 48.1, 12.4);
  constexpr double kRadius = 20.0;
  build(
      {49, 97, 25},
      [&](const glm::dvec3& p) { return kRadius - glm::length((p - center) * spacing); }, spacing);
  Random random(6);
  for (int i = 0; i < 6; ++i) {
    const glm::dvec3 a = randomDirection(random), b = randomDirection(random);
    const SurfacePath found = path(world(center) + kRadius * a, world(center) + kRadius * b);
    const double angle = std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
    EXPECT_NEAR(found.length, kRadius * angle, 0.01 * kRadius * angle) << i;
  }
}

TEST_F(SurfacePathTest, OnACylinderItIsAHelix) {
  constexpr double kRadius = 20.0;
  build({56, 56, 81},
        [&](const glm::dvec3& p) { return kRadius - std::hypot(p.x - 27.3, p.y - 27.6); });
  const auto at = [&](double angle, double z) {
    return world({27.3 + kRadius * std::cos(angle), 27.6 + kRadius * std::sin(angle), z});
  };
  for (const double turn : {0.3, 1.5, 2.5, 3.0}) {
    const double expected = std::hypot(kRadius * turn, 50.0);
    EXPECT_NEAR(path(at(0.4, 15), at(0.4 + turn, 65)).length, expected, 0.004 * expected);
  }
}

TEST_F(SurfacePathTest, OnATorusItGoesRoundTheHole) {
  // Between opposite points of the inner circle, along it: a shortest path by symmetry.
  build({71, 71, 31}, [&](const glm::dvec3& p) {
    return 8.0 - std::hypot(std::hypot(p.x - 35.2, p.y - 35.4) - 22.0, p.z - 15.3);
  });
  const double expected = 14.0 * std::numbers::pi;
  EXPECT_NEAR(path(world({21.2, 35.4, 15.3}), world({49.2, 35.4, 15.3})).length, expected,
              0.005 * expected);
}

TEST_F(SurfacePathTest, OnAPlaneItIsStraight) {
  const glm::dvec3 normal = glm::normalize(glm::dvec3(1, 2, 3)), middle(20, 20, 20);
  build(Index3(41), [&](const glm::dvec3& p) { return glm::dot(normal, p - middle); });
  const glm::dvec3 along = glm::normalize(glm::cross(normal, {0, 0, 1}));
  const glm::dvec3 up = glm::cross(normal, along);
  const glm::dvec3 a = middle + 14.0 * along - 3.0 * up, b = middle - 12.0 * along + 5.0 * up;
  EXPECT_NEAR(path(world(a), world(b)).length, glm::distance(a, b), 1e-3);
  EXPECT_NEAR(path(world(a), world(a)).length, 0.0, 1e-6);
}

TEST_F(SurfacePathTest, ThroughAThinWallItIsTheLongWayRound) {
  // A plate of 3 voxels: the points are near each other, but apart on the surface.
  build({65, 65, 33}, [&](const glm::dvec3& p) {
    const glm::dvec3 off = glm::abs(p - glm::dvec3(32.3, 32.4, 16.2)) - glm::dvec3(25, 20, 1.5);
    return -std::max({off.x, off.y, off.z});
  });
  const SurfacePath found = path(world({32.3, 32.4, 17.7}), world({32.3, 32.4, 14.7}));
  // Cells cut the plate's edges off.
  EXPECT_NEAR(found.length, 2 * 20.0 + 3.0, 0.8);
}

TEST_F(SurfacePathTest, ThereIsNoneBetweenTwoPieces) {
  const glm::dvec3 a(20, 20, 20), b(20, 20, 45);
  build({41, 41, 65}, [&](const glm::dvec3& p) {
    return 10.0 - std::min(glm::distance(p, a), glm::distance(p, b));
  });
  EXPECT_EQ(refusal(world({20, 20, 30}), world({20, 20, 35})),
            "no path over the surface: the points lie on different pieces of it");
  EXPECT_EQ(refusal(world({20, 20, 30}), world({20, 20, 22})),
            "no path over the surface: point 2 is not on the surface of this isovalue");
  EXPECT_EQ(refusal(world({20, 20, 30}), world({20, 20, 30}), 9.5),
            "no path over the surface: point 1 is not on the surface of this isovalue");
}

TEST_F(SurfacePathTest, TakesACoarserLevelIfMemoryIsShort) {
  const glm::dvec3 center(32.2, 32.1, 31.8);
  build(Index3(65), [&](const glm::dvec3& p) { return 28.0 - glm::distance(p, center); });
  const glm::dvec3 from = world(center + glm::dvec3(28, 0, 0));
  const glm::dvec3 to = world(center - glm::dvec3(28, 0, 0));
  const SurfacePath coarse = path(from, to, 0.0, 1'500'000);
  EXPECT_GT(coarse.level, 0);
  EXPECT_NEAR(coarse.length, 28.0 * std::numbers::pi, 0.04 * 28.0 * std::numbers::pi);
  EXPECT_THROW(path(from, to, 0.0, 1000), Error);
}

// Far less than all of the surface is extracted for points near each other.
TEST_F(SurfacePathTest, ExtractsOnlyWhatIsNear) {
  const glm::dvec3 center(64.3, 64.2, 64.1);
  build(Index3(129), [&](const glm::dvec3& p) { return 60.0 - glm::distance(p, center); });
  const glm::dvec3 from = world(center + 60.0 * glm::dvec3(1, 0, 0));
  const glm::dvec3 to = world(center + 60.0 * glm::normalize(glm::dvec3(1, 0.1, 0)));
  CountingSink all, near;
  Query query;
  extractIsosurface(*pyramid_, query, all);
  const Ellipsoid ellipsoid{from, to, 1.5 * glm::distance(from, to)};
  query.box = ellipsoid.box(pyramid_->spec().geometry);
  NearSurface filter(ellipsoid, 1'000'000, near);
  extractIsosurface(*pyramid_, query, filter);
  EXPECT_LT(100 * near.triangles(), all.triangles());
  EXPECT_GT(near.triangles(), 50u);
  EXPECT_NEAR(path(from, to).length, 60.0 * std::atan(0.1), 0.02);
  NearSurface less(ellipsoid, 10, near);
  EXPECT_THROW(extractIsosurface(*pyramid_, query, less), TooMuchSurface);
}

TEST_F(SurfacePathTest, EndsWhenItIsCancelled) {
  const glm::dvec3 center(20.2, 20.1, 20.3);
  build(Index3(41), [&](const glm::dvec3& p) { return 15.0 - glm::distance(p, center); });
  CancelFlag cancel;
  cancel.request();
  Extractor extractor(*pyramid_);
  EXPECT_THROW(findSurfacePath(extractor, *pyramid_,
                               {0.0, world({35.2, 20.1, 20.3}), world({5.2, 20.1, 20.3})},
                               {.cancel = &cancel}),
               Cancelled);
}

// The box holds the ellipsoid and touches it, in a world that is turned.
TEST(EllipsoidTest, ItsBoxIsTheLeastOne) {
  GridGeometry geometry;
  geometry.spacing = {0.5, 1.0, 2.0};
  geometry.origin = {10, 20, 30};
  const double turn = 0.4;
  geometry.direction = {
      std::cos(turn), std::sin(turn), 0, -std::sin(turn), std::cos(turn), 0, 0, 0, 1};
  const Ellipsoid ellipsoid{{15, 22, 33}, {18, 29, 31}, 12.0};
  const QueryBox box = ellipsoid.box(geometry);
  const double between = glm::distance(ellipsoid.from, ellipsoid.to);
  const glm::dvec3 along = (ellipsoid.to - ellipsoid.from) / between;
  const glm::dvec3 side = glm::normalize(glm::cross(along, {0, 0, 1}));
  const glm::dvec3 up = glm::cross(along, side);
  const double across = std::sqrt(36.0 - 0.25 * between * between);
  Random random(7);
  glm::dvec3 least(1e9), most(-1e9);
  for (int i = 0; i < 100000; ++i) {
    const glm::dvec3 d = randomDirection(random);
    const glm::dvec3 index =
        geometry.worldToIndex(0.5 * (ellipsoid.from + ellipsoid.to) + 6.0 * d.x * along +
                              across * (d.y * side + d.z * up));
    least = glm::min(least, index);
    most = glm::max(most, index);
  }
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_LE(box.min[axis], least[axis]);
    EXPECT_GE(box.max[axis], most[axis]);
    EXPECT_NEAR(box.min[axis], least[axis], 0.02);
    EXPECT_NEAR(box.max[axis], most[axis], 0.02);
  }
}

}  // namespace
}  // namespace isobrick::test
