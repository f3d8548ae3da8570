#include "isobrick/viewer/session/shown_mesh.h"

#include <array>
#include <unordered_map>

#include "isobrick/storage/checksum.h"

namespace isobrick {
namespace {

// The position of a vertex, in voxels, and its surface.
using Place = std::array<double, 4>;

struct PlaceHash {
  std::size_t operator()(const Place& place) const {
    return checksum64(place.data(), sizeof(Place));
  }
};

}  // namespace

void takeShownMesh(const SceneReadback& renderer, const std::vector<ChunkId>& chunks,
                   const MeshFrame& frame, TriangleSink& sink) {
  std::unordered_map<Place, EdgeKey, PlaceHash> keys;  // the vertex's edge is not stored any more
  sink.begin(frame);
  for (const ChunkId id : chunks) {
    const SurfaceChunk chunk = renderer.download(id);
    PlacedBatch placed;
    MeshBatch& batch = placed.batch;
    batch.level = chunk.level;
    batch.origin = Index3(chunk.origin);
    batch.triangles.assign(chunk.triangles.begin(), chunk.triangles.end());
    for (const SurfaceVertex& vertex : chunk.vertices) {
      // Adding 0 makes the two zeros one.
      const glm::dvec3 at = chunk.origin + glm::dvec3(vertex.position) + 0.0;
      const auto entry =
          keys.try_emplace({at.x, at.y, at.z, static_cast<double>(chunk.surface)}, keys.size());
      batch.shared.push_back(
          {static_cast<std::uint32_t>(batch.positions.size()), 0, entry.first->second});
      batch.positions.push_back(vertex.position);
      batch.normals.push_back(unpackNormal(vertex.normal));
    }
    sink.place(placed);
    sink.write(placed);
  }
  sink.finish();
}

}  // namespace isobrick
