#include "isobrick/extract/sinks/indexed_mesh.h"

#include <limits>

#include "isobrick/storage/error.h"

namespace isobrick {

void IndexedMeshSink::place(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  numbering_.place(placed);
  if (numbering_.count() > std::numeric_limits<std::uint32_t>::max())
    throw Error(
        "the mesh has more than 4,294,967,295 vertices; extract a part of it or a coarser "
        "level, or stream it to a file");
  forEachNewRun(placed, [&](std::size_t begin, std::size_t end, std::uint64_t) {
    for (std::size_t v = begin; v < end; ++v) {
      mesh_.positions.push_back(placement_.worldPosition(batch, static_cast<std::uint32_t>(v)));
      mesh_.normals.push_back(batch.normals[v]);
    }
  });
  findNumbers(placed);
  for (const std::uint32_t v : batch.triangles) mesh_.triangles.push_back(placed.numbers[v]);
  mesh_.triangle_levels.insert(mesh_.triangle_levels.end(), batch.triangles.size() / 3,
                               static_cast<std::uint8_t>(batch.level));
  mesh_.triangle_caps.resize(mesh_.triangle_levels.size() - batch.cap_indices / 3, 0);
  mesh_.triangle_caps.resize(mesh_.triangle_levels.size(), 1);
}

}  // namespace isobrick
