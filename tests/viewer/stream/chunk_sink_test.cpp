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
  ChunkSink sink(3, [&](std::size_t place, SurfaceChunk&& chunk) {
    const std::lock_guard lock(mutex);
    if (chunks.size() <= place) chunks.resize(place + 1);
    chunks[place] = std::move(chunk);
  });
  extractIsosurface(pyramid, query, sink);
  ASSERT_GT(chunks.size(), 10u);

  const SceneLattice lattice = latticeOf(geometry);
  std::size_t corner = 0;
  for (const SurfaceChunk& chunk : chunks) {
    EXPECT_EQ(chunk.surface, 3);
    for (const std::uint32_t v : chunk.triangles) {
      ASSERT_LT(corner, mesh.triangles.size());
      EXPECT_EQ(chunk.level, mesh.triangle_levels[corner / 3]);
      const glm::dvec3 world =
          lattice.toWorld(chunk.origin + glm::dvec3(chunk.vertices[v].position));
      ASSERT_LT(glm::distance(world, mesh.positions[mesh.triangles[corner]]), 1e-9);
      ASSERT_EQ(chunk.vertices[v].normal, packNormal(mesh.normals[mesh.triangles[corner]]));
      ++corner;
    }
  }
  EXPECT_EQ(corner, mesh.triangles.size());
}

}  // namespace
}  // namespace isobrick
