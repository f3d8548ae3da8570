// Chunks: cut from meshes, and as exact far from the world's origin as near it.
#include "isobrick/viewer/stream/surface_chunk.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <random>

#include "isobrick/viewer/offscreen_renderer.h"

namespace isobrick {
namespace {

// A vertex on the side of two bricks, with the bits that the extractor gives it in each; and eyes
// anywhere, in a volume of 2^20 voxels.
TEST(SurfaceChunkTest, NeighboursGiveASharedVertexTheSameBits) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> number(0.0, 1.0);
  int rounded = 0;
  for (int i = 0; i < 20000; ++i) {
    const double size = std::ldexp(1.0, static_cast<int>(random() % 14) + 7);
    const glm::dvec3 brick =
        glm::floor(glm::dvec3(number(random), number(random), number(random)) * size / 64.0) * 64.0;
    const glm::dvec3 next = brick + glm::dvec3(64.0, 0.0, 0.0);
    // Crossings lie on multiples of 2^-17 of an edge here, at the side of both bricks.
    const glm::dvec3 inside(64.0, std::floor(number(random) * 64.0), 64.0 * number(random));
    const glm::vec3 here(inside);
    const glm::vec3 there(here.x - 64.0f, here.y, here.z);
    const glm::dvec3 eye = size * glm::dvec3(number(random), 3.0 * number(random) - 1.0, 0.5);
    const SnappedEye snapped = snapEye(eye, 4.0 * size);
    EXPECT_EQ(snapped.snapped + snapped.rest, eye);
    const glm::vec3 a = here + snapped.offsetOf(brick), b = there + snapped.offsetOf(next);
    ASSERT_EQ(a, b) << size;
    // What one rounding to float leaves, of the distance from the eye.
    const glm::dvec3 exact = brick + glm::dvec3(here) - snapped.snapped;
    EXPECT_LE(glm::distance(glm::dvec3(a), exact), 1.1e-7 * (1.0 + glm::length(exact)));
    if (glm::vec3(brick - eye) + here != glm::vec3(next - eye) + there) ++rounded;
  }
  EXPECT_GT(rounded, 1000);  // without the snapping they differ
}

struct Grid {
  std::vector<glm::vec3> positions, normals;
  std::vector<std::uint32_t> triangles;
  std::vector<std::uint8_t> levels;
};

// A plane of 2 * cells^2 triangles, far from the origin, with levels in stripes.
Grid makeGrid(std::uint32_t cells) {
  Grid grid;
  for (std::uint32_t y = 0; y <= cells; ++y) {
    for (std::uint32_t x = 0; x <= cells; ++x) {
      grid.positions.emplace_back(90000.0f + static_cast<float>(x), static_cast<float>(y), -70.0f);
      grid.normals.emplace_back(0.0f, 0.0f, 1.0f);
    }
  }
  for (std::uint32_t y = 0; y < cells; ++y) {
    for (std::uint32_t x = 0; x < cells; ++x) {
      const std::uint32_t a = y * (cells + 1) + x, b = a + cells + 1;
      for (const std::uint32_t v : {a, a + 1, b, a + 1, b + 1, b}) grid.triangles.push_back(v);
      grid.levels.insert(grid.levels.end(), 2, static_cast<std::uint8_t>(x % 3));
    }
  }
  return grid;
}

TEST(SurfaceChunkTest, AMeshInChunksIsTheSameMesh) {
  const Grid grid = makeGrid(400);  // 320,000 triangles: more than one chunk holds
  const auto chunks = chunksOf({grid.positions, grid.normals, grid.triangles, grid.levels}, false);
  ASSERT_EQ(chunks.size(), 2u);
  std::size_t corner = 0;
  for (const SurfaceChunk& chunk : chunks) {
    EXPECT_LT(chunk.vertices.size(), chunk.triangles.size() / 4);  // they are shared
    EXPECT_EQ(chunk.level, 0);
    for (const std::uint32_t v : chunk.triangles) {
      const glm::dvec3 world = chunk.origin + glm::dvec3(chunk.vertices[v].position);
      ASSERT_EQ(world, glm::dvec3(grid.positions[grid.triangles[corner]]));
      ASSERT_EQ(chunk.vertices[v].normal[2], 32767);
      ++corner;
    }
  }
  EXPECT_EQ(corner, grid.triangles.size());
}

TEST(SurfaceChunkTest, LevelsAreChunksOfTheirOwn) {
  const Grid grid = makeGrid(30);
  const auto chunks = chunksOf({grid.positions, grid.normals, grid.triangles, grid.levels}, true);
  ASSERT_EQ(chunks.size(), 3u);
  for (int level = 0; level < 3; ++level) {
    const SurfaceChunk& chunk = chunks[static_cast<std::size_t>(level)];
    EXPECT_EQ(chunk.level, level);
    EXPECT_EQ(chunk.triangles.size(), grid.triangles.size() / 3);
    EXPECT_EQ(chunk.bytes(), chunk.vertices.size() * 20 + chunk.triangles.size() * 4);
  }
  EXPECT_TRUE(chunksOf({}, true).empty());
}

TEST(SurfaceChunkTest, WithoutNormalsEveryTriangleIsAFacet) {
  const std::vector<glm::vec3> positions{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const std::vector<std::uint32_t> triangles{0, 1, 2, 0, 3, 1};
  const auto chunks = chunksOf({positions, {}, triangles, {}}, false);
  ASSERT_EQ(chunks.size(), 1u);
  ASSERT_EQ(chunks[0].vertices.size(), 6u);
  EXPECT_EQ(chunks[0].vertices[0].normal, (std::array<std::int16_t, 3>{0, 0, 32767}));
  EXPECT_EQ(chunks[0].vertices[5].normal, (std::array<std::int16_t, 3>{0, 32767, 0}));
}

}  // namespace
}  // namespace isobrick
