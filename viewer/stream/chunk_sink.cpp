#include "isobrick/viewer/stream/chunk_sink.h"

#include <iterator>
#include <vector>

namespace isobrick {

namespace {

// Triangles of fans to the end; in each part the order stays.
void addTriangles(const MeshBatch& batch, SurfaceChunk& chunk) {
  chunk.triangles.reserve(batch.triangles.size());
  auto hub = batch.fan_hubs.begin();
  const auto end = batch.fan_hubs.end();
  std::vector<std::uint32_t> of_fans;
  for (std::size_t t = 0; t < batch.triangles.size(); t += 3) {
    const std::uint32_t first = batch.triangles[t];
    if (hub != end && *hub != first && std::next(hub) != end && *std::next(hub) == first) ++hub;
    std::vector<std::uint32_t>& part = hub != end && *hub == first ? of_fans : chunk.triangles;
    part.insert(part.end(), batch.triangles.begin() + static_cast<std::ptrdiff_t>(t),
                batch.triangles.begin() + static_cast<std::ptrdiff_t>(t + 3));
  }
  chunk.triangles.insert(chunk.triangles.end(), of_fans.begin(), of_fans.end());
  chunk.transition_indices = of_fans.size();
}

}  // namespace

void ChunkSink::write(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  SurfaceChunk chunk;
  chunk.origin = glm::dvec3(batch.origin);
  chunk.level = batch.level;
  chunk.surface = surface_;
  chunk.cells = batch.cells;
  if (batch.is_uniform) {
    chunk.key = key_;
    chunk.key->level = batch.level;
    chunk.key->brick = {batch.brick.x, batch.brick.y, batch.brick.z};
  }
  chunk.vertices.resize(batch.positions.size());
  for (std::size_t v = 0; v < batch.positions.size(); ++v)
    chunk.vertices[v] = {batch.positions[v], packNormal(batch.normals[v])};
  if (values_ != nullptr) {
    placed.values.resize(batch.positions.size());
    values_->evaluate(placed, placed.values);
    for (std::size_t v = 0; v < placed.values.size(); ++v)
      chunk.vertices[v].value = packValue(placed.values[v]);
  }
  addTriangles(batch, chunk);
  take_(static_cast<std::size_t>(placed.first_byte), std::move(chunk));
}

SceneLattice latticeOf(const GridGeometry& geometry) {
  return {geometry.indexToWorldMatrix(), geometry.origin};
}

}  // namespace isobrick
