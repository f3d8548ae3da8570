// Meshes in other axes, other units, and moved.
#include "isobrick/extract/sinks/mesh_placement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/pyramid_values.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/ply_reader.h"

namespace isobrick::test {
namespace {

constexpr double kRadius = 4.1;  // millimetres

class MeshPlacementTest : public ::testing::Test {
 protected:
  static GridGeometry geometryOf(double flip, LengthUnit unit = LengthUnit::kMillimetre) {
    GridGeometry geometry;
    geometry.spacing = {0.5, 0.8, 0.4};
    geometry.origin = {-20, 31, 7};
    geometry.direction = glm::dmat3(0, 1, 0, -1, 0, 0, 0, 0, flip);
    geometry.unit = unit;
    return geometry;
  }
  // A ball in the world.
  std::shared_ptr<const Pyramid> ball(const GridGeometry& geometry) const {
    const glm::dvec3 center = geometry.indexToWorld(kCenter);
    return openField(
        folder_, Index3(27, 20, 32),
        [&](const glm::dvec3& p) {
          return kRadius - glm::length(geometry.indexToWorld(p) - center);
        },
        geometry);
  }
  PlyMesh placed(const Pyramid& pyramid, const MeshPlacement& placement,
                 InsideOf inside = InsideOf::kAbove) const {
    const auto sink = makeMeshFileSink(folder_.file("mesh.ply"), {.placement = placement});
    Query query;
    query.inside = inside;
    extractIsosurface(pyramid, query, *sink);
    return readPly(folder_.file("mesh.ply"));
  }
  std::string header() const { return readBytes(folder_.file("mesh.ply")).substr(0, 512); }
  static MeshReport checked(const PlyMesh& mesh) {
    const MeshReport report =
        checkMesh(std::span<const glm::dvec3>(mesh.positions), mesh.triangles);
    EXPECT_TRUE(report.ok()) << report.summary();
    return report;
  }

  inline static const glm::dvec3 kCenter{13.2, 9.4, 15.8};
  const TemporaryFolder folder_;
};

TEST_F(MeshPlacementTest, RasTurnsRoundTheAxisOfTheBody) {
  for (const double flip : {1.0, -1.0}) {
    const auto pyramid = ball(geometryOf(flip));
    const PlyMesh lps = placed(*pyramid, {});
    EXPECT_NE(header().find("comment space: LPS\n"), std::string::npos);
    const PlyMesh ras = placed(*pyramid, {.space = MeshSpace::kRas});
    EXPECT_NE(header().find("comment units: millimetres\ncomment space: RAS\n"), std::string::npos);
    ASSERT_EQ(ras.triangles, lps.triangles);
    ASSERT_EQ(ras.positions.size(), lps.positions.size());
    for (std::size_t v = 0; v < ras.positions.size(); ++v) {
      ASSERT_EQ(ras.positions[v], lps.positions[v] * glm::dvec3(-1, -1, 1));
      ASSERT_LT(glm::distance(ras.normals[v], lps.normals[v] * glm::dvec3(-1, -1, 1)), 1e-6);
    }
    EXPECT_NEAR(checked(ras).volume, 4.0 / 3 * M_PI * std::pow(kRadius, 3), 5);
  }
}

// Voxel indices stretch the ball: its volume counts voxels, and normals are those of an ellipsoid.
TEST_F(MeshPlacementTest, IndicesAreOutwardWhateverTheAxes) {
  for (const double flip : {1.0, -1.0})
    for (const InsideOf inside : {InsideOf::kAbove, InsideOf::kBelow}) {
      const GridGeometry geometry = geometryOf(flip);
      const auto pyramid = ball(geometry);
      const PlyMesh mesh = placed(*pyramid, {.space = MeshSpace::kIndex}, inside);
      EXPECT_NE(header().find("comment units: voxels\ncomment space: index\n"), std::string::npos);
      const double side = inside == InsideOf::kAbove ? 1 : -1;
      const double right = 4.0 / 3 * M_PI * std::pow(kRadius, 3) / (0.5 * 0.8 * 0.4);
      EXPECT_NEAR(side * checked(mesh).volume, right, 0.02 * right);
      for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        const glm::dvec3 away = (mesh.positions[v] - kCenter) * geometry.spacing;
        ASSERT_NEAR(glm::length(away), kRadius, 0.05);
        const glm::dvec3 outward = glm::normalize(away * geometry.spacing);
        ASSERT_GT(side * glm::dot(outward, mesh.normals[v]), 0.99);
      }
    }
}

TEST_F(MeshPlacementTest, UnitsScaleAndShiftsComeLast) {
  const auto pyramid = ball(geometryOf(1));
  const PlyMesh mm = placed(*pyramid, {});
  const glm::dvec3 shift(1.5, -2, 3);
  const PlyMesh inches =
      placed(*pyramid, {.space = MeshSpace::kRas, .unit = "inch", .shift = shift});
  EXPECT_NE(header().find("comment units: inches\ncomment space: RAS\ncomment shift: 1.5 -2 3\n"),
            std::string::npos);
  for (std::size_t v = 0; v < mm.positions.size(); ++v)
    ASSERT_LT(
        glm::distance(inches.positions[v], mm.positions[v] * glm::dvec3(-1, -1, 1) / 25.4 + shift),
        1e-6);
  EXPECT_NEAR(checked(placed(*pyramid, {.unit = "um"})).volume, 1e9 * checked(mm).volume, 1e6);
}

TEST_F(MeshPlacementTest, WhatHasNoUnitIsRefused) {
  const auto known = ball(geometryOf(1));
  const TemporaryFolder other;
  const auto unknown =
      openField(other, Index3(20), [](const glm::dvec3& p) { return 6.0 - glm::length(p - 9.5); });
  const auto refusal = [&](const Pyramid& pyramid, const MeshPlacement& placement) {
    try {
      placed(pyramid, placement);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(refusal(*unknown, {.unit = "mm"}).find("unit of the volume is unknown"),
            std::string::npos);
  EXPECT_NE(refusal(*known, {.unit = "mile"}).find("the units are nm, um, mm, cm, m, inch, ft"),
            std::string::npos);
  EXPECT_NE(refusal(*known, {.space = MeshSpace::kIndex, .unit = "mm"}).find("no unit"),
            std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(folder_.file("mesh.ply")));
}

// Coordinates of a map, voxels of a decimetre: near the origin single precision is enough for them.
TEST_F(MeshPlacementTest, AShiftKeepsDetailInSinglePrecision) {
  GridGeometry geometry;
  geometry.spacing = glm::dvec3(0.1);
  geometry.origin = {499999.3, 4200001.7, 12.4};
  geometry.unit = LengthUnit::kMillimetre;
  const glm::dvec3 middle = geometry.indexToWorld(glm::dvec3(9.7, 10.2, 9.9));
  const auto pyramid = openField(
      folder_, Index3(20),
      [&](const glm::dvec3& p) { return 7.3 - glm::length(p - glm::dvec3(9.7, 10.2, 9.9)); },
      geometry);
  const auto lossOf = [&](const char* name, const MeshPlacement& placement) {
    const auto sink = makeMeshFileSink(folder_.file(name), {.placement = placement});
    extractIsosurface(*pyramid, Query{}, *sink);
    return sink->loss();
  };
  for (const char* name : {"mesh.stl", "mesh.3mf"}) {
    EXPECT_NE(lossOf(name, {}), "") << name;
    EXPECT_EQ(lossOf(name, {.shift = {-500000, -4200000, 0}}), "") << name;
  }
  const PlyMesh moved = placed(*pyramid, {.shift = {-500000, -4200000, 0}});
  for (const glm::dvec3& p : moved.positions)
    ASSERT_NEAR(glm::distance(p, middle - glm::dvec3(500000, 4200000, 0)), 0.73, 0.01);
  EXPECT_NEAR(checked(moved).volume / 1e-3, 1629.5, 25);
}

// Values are those of the places in the world, wherever the file has them.
TEST_F(MeshPlacementTest, AttributesAreThoseOfTheWorld) {
  const auto pyramid = ball(geometryOf(-1));
  const PyramidValues values(*pyramid);
  const auto bytesOf = [&](const MeshPlacement& placement) {
    const auto sink = makeMeshFileSink(
        folder_.file("values.ply"), {.attributes = {{.values = &values}}, .placement = placement});
    extractIsosurface(*pyramid, Query{}, *sink);
    const std::string bytes = readBytes(folder_.file("values.ply"));
    std::string found;
    const std::size_t vertices = placed(*pyramid, {}).positions.size();
    for (std::size_t v = 0; v < vertices; ++v) found += bytes.substr(512 + v * 28 + 24, 4);
    return found;
  };
  const std::string in_world = bytesOf({});
  EXPECT_EQ(bytesOf({.space = MeshSpace::kRas, .unit = "cm", .shift = {1, 2, 3}}), in_world);
  EXPECT_EQ(bytesOf({.space = MeshSpace::kIndex}), in_world);
}

}  // namespace
}  // namespace isobrick::test
