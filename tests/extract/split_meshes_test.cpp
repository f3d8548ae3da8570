// The meshes that docs/PAPER.md compares the fans with: the conforming split is closed, and leaves
// that are left alone have cracks.

#include "tests/support/split_meshes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <vector>

#include "tests/support/array_source.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

ReferencePyramid noisyWaves(const Index3& dims, std::uint64_t seed) {
  Random random(seed);
  const double noise = randomReal(random, 0, 1);
  const std::vector<float> voxels = arrayOfField<float>(dims, [&](const Index3& p) {
    const glm::dvec3 q(p);
    return std::sin(0.5 * q.x) * std::cos(0.4 * q.y) + std::sin(0.3 * q.z) +
           randomReal(random, -noise, noise);
  });
  return buildReferencePyramid<float>(dims, voxels);
}

ReferencePyramid sphere(std::int64_t edge, double radius) {
  const std::vector<float> voxels = arrayOfField<float>(Index3(edge), [&](const Index3& p) {
    return radius - glm::length(glm::dvec3(p) - 0.5 * static_cast<double>(edge - 1));
  });
  return buildReferencePyramid<float>(Index3(edge), voxels);
}

ReferenceQuery aroundAnyPoint(const Index3& dims, Random& random) {
  ReferenceQuery query;
  query.focus = glm::dvec3(dims) * glm::dvec3(randomReal(random, 0, 1), randomReal(random, 0, 1),
                                              randomReal(random, 0, 1));
  query.radius = randomReal(random, 0, 4);
  // Some cells of level 1 stay: finer neighbours across an edge or a corner only.
  const std::uint64_t seed = random();
  query.flat = [seed](const Index3& cell) {
    return ((seed ^ static_cast<std::uint64_t>(cell.x * 73 + cell.y * 179 + cell.z * 283)) *
            0x9e3779b97f4a7c15u) >>
               63 !=
           0;
  };
  return query;
}

// Grids whose last cells are thin, too.
TEST(SplitMeshes, TheConformingSplitIsClosed) {
  std::int64_t split = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    Random random(seed);
    const Index3 dims(randomInt(random, 5, 24), randomInt(random, 5, 24), randomInt(random, 5, 24));
    const ReferencePyramid pyramid = noisyWaves(dims, seed);
    const LeafLevels leaves = referenceLeafLevels(pyramid.lattice, aroundAnyPoint(dims, random));
    const SplitMesh mesh = conformingSplitMesh(pyramid, leaves, 0.1);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions(dims));
    EXPECT_TRUE(report.ok()) << "seed " << seed << "\n" << report.summary();
    split += mesh.split_leaves;
  }
  EXPECT_GT(split, 1000);
}

TEST(SplitMeshes, LeavesOnTheirOwnHaveCracks) {
  const ReferencePyramid pyramid = sphere(33, 11);
  ReferenceQuery query;
  query.focus = glm::dvec3(27, 16, 16);
  const LeafLevels leaves = referenceLeafLevels(pyramid.lattice, query);
  const SplitMesh cracked = crackedMesh(pyramid, leaves, 0);
  EXPECT_GT(checkMesh(cracked.positions, cracked.triangles, indexOptions(Index3(33))).open_edges,
            20);
  const SplitMesh closed = conformingSplitMesh(pyramid, leaves, 0);
  const MeshReport report = checkMesh(closed.positions, closed.triangles);
  EXPECT_TRUE(report.ok()) << report.summary();
  EXPECT_EQ(report.genus, 0);
}

TEST(SplitMeshes, OnOneLevelBothAreMarchingCubes) {
  const Index3 dims(19, 22, 17);
  const ReferencePyramid pyramid = noisyWaves(dims, 5);
  for (int level = 0; level < 3; ++level) {
    ReferenceQuery query;
    query.iso = 0.1;
    query.level = level;
    const LeafLevels leaves = referenceLeafLevels(pyramid.lattice, query);
    const std::int64_t expected = referenceMesh(pyramid, query).triangleCount();
    EXPECT_EQ(crackedMesh(pyramid, leaves, 0.1).triangleCount(), expected);
    EXPECT_EQ(conformingSplitMesh(pyramid, leaves, 0.1).triangleCount(), expected);
  }
}

// The split of a cube costs triangles: in the paper's Figure 5 more than the coarser leaves save.
TEST(SplitMeshes, TheConformingSplitHasMoreTrianglesThanFans) {
  const ReferencePyramid pyramid = sphere(33, 11);
  ReferenceQuery query;
  query.focus = glm::dvec3(27, 16, 16);
  const std::int64_t fans = referenceMesh(pyramid, query).triangleCount();
  const SplitMesh split =
      conformingSplitMesh(pyramid, referenceLeafLevels(pyramid.lattice, query), 0);
  EXPECT_GT(split.triangleCount(), fans + fans / 4);
}

}  // namespace
}  // namespace isobrick::test
