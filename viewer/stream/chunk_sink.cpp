#include "isobrick/viewer/stream/chunk_sink.h"

namespace isobrick {

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
  chunk.triangles.assign(batch.triangles.begin(), batch.triangles.end());
  chunk.transition_indices = batch.transition_indices;
  take_(static_cast<std::size_t>(placed.first_byte), std::move(chunk));
}

SceneLattice latticeOf(const GridGeometry& geometry) {
  return {geometry.indexToWorldMatrix(), geometry.origin};
}

}  // namespace isobrick
