// The chunks of an extraction are its mesh.
#include "isobrick/viewer/stream/chunk_sink.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <mutex>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "tests/support/field_pyramid.h"

namespace isobrick {
namespace {

TEST(ChunkSinkTest, ChunksInTheirPlacesAreTheMeshOfTheSameQuery) {
  const test::TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 16;
  GridGeometry geometry;
  geometry.spacing = {0.5, 1.0, 2.0};
  geometry.origin = {-1000.0, 20.0, 3.0};
  const Pyramid pyramid(test::buildField(
      folder, Index3(50),
      [](const glm::dvec3& p) { return 20.0 - glm::distance(p, glm::dvec3(25.0)); }, options,
      geometry));
  Query query;
  query.isovalue = 0.5;
  query.focus = FocusSphere{{10.0, 20.0, 20.0}, 12.0};

  IndexedMeshSink mesh_sink;
  extractIsosurface(pyramid, query, mesh_sink);
  const IndexedMesh& mesh = mesh_sink.mesh();

  std::mutex mutex;
  std::vector<SurfaceChunk> chunks;
  ChunkSink sink({.surface = 3, .isovalue = query.isovalue}, {},
                 [&](std::size_t place, SurfaceChunk&& chunk) {
                   const std::lock_guard lock(mutex);
                   if (chunks.size() <= place) chunks.resize(place + 1);
                   chunks[place] = std::move(chunk);
                 });
  const ExtractionReport report = extractIsosurface(pyramid, query, sink);
  ASSERT_GT(chunks.size(), 10u);

  const SceneLattice lattice = latticeOf(geometry);
  std::size_t corner = 0, highlighted = 0;
  for (const SurfaceChunk& chunk : chunks) {
    EXPECT_EQ(chunk.surface, 3);
    EXPECT_EQ(chunk.transition_indices % 3, 0u);
    highlighted += chunk.transition_indices / 3;
    const auto matches = [&](std::size_t index) {
      for (std::size_t k = 0; k < 3; ++k) {
        const SurfaceVertex& vertex = chunk.vertices[chunk.triangles[index + k]];
        const std::uint32_t expected = mesh.triangles[corner + k];
        const glm::dvec3 world = lattice.toWorld(chunk.origin + glm::dvec3(vertex.position));
        if (!(glm::distance(world, mesh.positions[expected]) < 1e-9)) return false;
        if (vertex.normal != packNormal(mesh.normals[expected])) return false;
        if (vertex.value != kNoVertexValue) return false;
      }
      return true;
    };
    // Those of transitions come last; in each part the order is the mesh's.
    const std::size_t plain_end = chunk.triangles.size() - chunk.transition_indices;
    std::size_t plain = 0, transition = plain_end;
    while (plain < plain_end || transition < chunk.triangles.size()) {
      ASSERT_LT(corner, mesh.triangles.size());
      EXPECT_EQ(chunk.level, mesh.triangle_levels[corner / 3]);
      if (plain < plain_end && matches(plain))
        plain += 3;
      else if (transition < chunk.triangles.size() && matches(transition))
        transition += 3;
      else
        FAIL() << "triangle " << corner / 3;
      corner += 3;
    }
  }
  EXPECT_EQ(corner, mesh.triangles.size());
  // A loop through the face beside finer leaves has at least a triangle.
  std::uint64_t cells = 0;
  for (const LevelCounts& level : report.levels) cells += level.transition_cells;
  EXPECT_GT(cells, 50u);
  EXPECT_GE(highlighted, cells);
  EXPECT_LT(highlighted, 16 * cells);
}

}  // namespace
}  // namespace isobrick
