#include "isobrick/extract/sinks/indexed_mesh.h"

#include <limits>

#include "isobrick/storage/error.h"

namespace isobrick {

void IndexedMeshSink::accept(const MeshBatch& batch) {
  numbering_.number(batch, numbers_, is_new_);
  if (numbering_.count() > std::numeric_limits<std::uint32_t>::max())
    throw Error(
        "the mesh has more than 4,294,967,295 vertices; extract a part of it or a coarser "
        "level, or stream it to a file");
  for (std::size_t v = 0; v < numbers_.size(); ++v) {
    if (!is_new_[v]) continue;
    mesh_.positions.push_back(batch.positions[v]);
    mesh_.normals.push_back(batch.normals[v]);
  }
  for (const std::uint32_t v : batch.triangles)
    mesh_.triangles.push_back(static_cast<std::uint32_t>(numbers_[v]));
  mesh_.triangle_levels.insert(mesh_.triangle_levels.end(), batch.triangles.size() / 3,
                               static_cast<std::uint8_t>(batch.level));
}

}  // namespace isobrick
