// Meshes as chunks: the same triangles, and levels apart.
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "isobrick/viewer/render_mesh.h"

namespace isobrick {
namespace {

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

TEST(MeshChunksTest, AMeshInChunksIsTheSameMesh) {
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

TEST(MeshChunksTest, LevelsAreChunksOfTheirOwn) {
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

TEST(MeshChunksTest, WithoutNormalsEveryTriangleIsAFacet) {
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
