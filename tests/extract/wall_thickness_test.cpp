// The thickness of walls whose shape is known.
#include "isobrick/extract/wall_thickness.h"

#include <gtest/gtest.h>

#include <cmath>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "tests/support/field_pyramid.h"

namespace isobrick::test {
namespace {

class WallThicknessTest : public ::testing::Test {
 protected:
  // At every vertex of the surface at 0.
  std::vector<double> thicknessOf(const Pyramid& pyramid,
                                  double most = std::numeric_limits<double>::infinity()) {
    IndexedMeshSink sink;
    extractIsosurface(pyramid, Query{}, sink);
    mesh_ = sink.takeMesh();
    std::vector<double> thickness(mesh_.positions.size());
    WallThickness(pyramid, 0, most).evaluate(mesh_.positions, mesh_.normals, thickness);
    return thickness;
  }

  const TemporaryFolder folder_;
  IndexedMesh mesh_;
};

// The field is linear on both sides, so that nothing is lost between voxels; turned and stretched.
TEST_F(WallThicknessTest, OfAPlateIsExact) {
  GridGeometry geometry;
  geometry.spacing = {0.5, 2, 1.25};
  geometry.origin = {-100, 50, 7};
  const double c = std::cos(0.4), s = std::sin(0.4);
  geometry.direction = glm::dmat3(c, s, 0, -s, c, 0, 0, 0, -1);
  const auto pyramid = openField(
      folder_, {40, 19, 35}, [](const glm::dvec3& p) { return 6.25 - std::abs(p.z - 16); },
      geometry);
  const std::vector<double> thickness = thicknessOf(*pyramid);
  ASSERT_GT(thickness.size(), 1000u);
  for (const double one : thickness) ASSERT_NEAR(one, 12.5 * 1.25, 1e-5);
  for (const double one : thicknessOf(*pyramid, 3)) ASSERT_EQ(one, 3);
}

TEST_F(WallThicknessTest, OfAShellIsItsOwnFromBothSides) {
  const glm::dvec3 center(24.3, 23.6, 24.9);
  const auto pyramid = openField(folder_, Index3(50), [&](const glm::dvec3& p) {
    return 3 - std::abs(glm::length(p - center) - 17);
  });
  const std::vector<double> thickness = thicknessOf(*pyramid);
  std::size_t inner = 0;
  for (std::size_t v = 0; v < thickness.size(); ++v) {
    ASSERT_NEAR(thickness[v], 6, 0.06) << v;
    inner += glm::length(mesh_.positions[v] - center) < 17;
  }
  EXPECT_GT(inner, 1000u);
  EXPECT_GT(thickness.size(), inner + 1000);
}

// Walls of less than a voxel, as long as voxels see them.
TEST_F(WallThicknessTest, OfAThinPlateIsThin) {
  const auto pyramid = openField(folder_, {12, 12, 30},
                                 [](const glm::dvec3& p) { return 0.4 - std::abs(p.z - 15); });
  for (const double one : thicknessOf(*pyramid)) ASSERT_NEAR(one, 0.8, 1e-5);
}

TEST_F(WallThicknessTest, EndsAtTheBorderOfTheVolume) {
  const auto pyramid =
      openField(folder_, {20, 21, 22}, [](const glm::dvec3& p) { return p.y - 5.5; });
  for (const double one : thicknessOf(*pyramid)) ASSERT_NEAR(one, 20 - 5.5, 1e-5);
  std::vector<double> below(mesh_.positions.size());
  for (glm::vec3& normal : mesh_.normals) normal = -normal;
  WallThickness(*pyramid, 0, 100, InsideOf::kBelow).evaluate(mesh_.positions, mesh_.normals, below);
  for (const double one : below) ASSERT_NEAR(one, 5.5, 1e-5);
}

// A mask: its values are those of its plateaus nearly everywhere.
TEST_F(WallThicknessTest, OfAMaskIsThatOfItsVoxels) {
  BuildOptions options;
  options.brick_cells = 16;
  const Pyramid pyramid(buildField<std::uint8_t>(
      folder_, {40, 20, 20}, [](const glm::dvec3& p) { return p.x >= 10 && p.x <= 29 ? 1.0 : 0.0; },
      options));
  IndexedMeshSink sink;
  Query query;
  query.isovalue = 1;  // of the plateau itself: it is inside
  extractIsosurface(pyramid, query, sink);
  const IndexedMesh& mesh = sink.mesh();
  std::vector<double> thickness(mesh.positions.size());
  WallThickness(pyramid, 1).evaluate(mesh.positions, mesh.normals, thickness);
  ASSERT_FALSE(thickness.empty());
  for (const double one : thickness) ASSERT_NEAR(one, 19, 1e-3);
}

// A vertex of a simplified or coarse mesh need not lie on the surface of level 0.
TEST_F(WallThicknessTest, CountsFromWhereTheRayComesIn) {
  const auto pyramid =
      openField(folder_, {12, 12, 30}, [](const glm::dvec3& p) { return 4 - std::abs(p.z - 15); });
  const WallThickness field(*pyramid, 0);
  const std::vector<glm::dvec3> places = {{5.2, 6.1, 22}, {5.2, 6.1, 17}, {5.2, 6.1, 22}};
  const std::vector<glm::vec3> normals = {{0, 0, 1}, {0, 0, 1}, {0, 0, -1}};
  std::vector<double> thickness(3);
  field.evaluate(places, normals, thickness);
  EXPECT_NEAR(thickness[0], 8, 1e-5);
  EXPECT_NEAR(thickness[1], 6, 1e-5);  // from the vertex
  EXPECT_TRUE(std::isnan(thickness[2]));
}

}  // namespace
}  // namespace isobrick::test
