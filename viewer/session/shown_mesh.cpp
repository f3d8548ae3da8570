#include "isobrick/viewer/session/shown_mesh.h"

#include <map>

#include "isobrick/viewer/stream/vertex_places.h"

namespace isobrick {

void takeShownMesh(const SceneReadback& renderer, const std::vector<ChunkId>& chunks,
                   const MeshFrame& frame, TriangleSink& sink) {
  std::map<int, VertexPlaces> places;  // by surface
  std::uint64_t known = 0;
  sink.begin(frame);
  for (const ChunkId id : chunks) {
    const SurfaceChunk chunk = renderer.download(id);
    PlacedBatch placed;
    MeshBatch& batch = placed.batch;
    batch.level = chunk.level;
    batch.origin = Index3(chunk.origin);
    batch.triangles.assign(chunk.triangles.begin(), chunk.triangles.end());
    for (const SurfaceVertex& vertex : chunk.vertices) {
      const EdgeKey key = places[chunk.surface].numberOf(chunk, vertex, known++);
      batch.shared.push_back({static_cast<std::uint32_t>(batch.positions.size()), 0, key});
      batch.positions.push_back(vertex.position);
      batch.normals.push_back(unpackNormal(vertex.normal));
    }
    sink.place(placed);
    sink.write(placed);
  }
  sink.finish();
}

}  // namespace isobrick
