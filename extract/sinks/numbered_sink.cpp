#include "isobrick/extract/sinks/numbered_sink.h"

#include <limits>

#include "isobrick/extract/pyramid_values.h"
#include "isobrick/storage/error.h"

namespace isobrick {

void NumberedMesh::begin(const MeshFrame& frame) {
  frame_ = frame;
  double_precision_ = frame_.coordinateMagnitudeInVoxels() >= 2048;
  placement_ = WorldPlacement(frame_.geometry);
  if (frame_.placed) volume_placement_ = WorldPlacement(frame_.placed->volume);
}

void NumberedMesh::place(PlacedBatch& placed) {
  if (options_.components && placed.components.size() != placed.batch.positions.size())
    throw Error("'" + path_ +
                    "': the vertices have no numbers of components; put a ComponentFilter or a "
                    "ComponentNumbering before the file",
                {.path = path_});
  numbering_.place(placed);
  if (numbering_.count() > std::numeric_limits<std::uint32_t>::max())
    throw Error("'" + path_ +
                    "': a mesh file holds at most 4,294,967,295 vertices; extract a part of the "
                    "surface or a coarser level",
                {.path = path_});
  placed.first_triangle = triangles_;
  placed.first_cap = caps_;
  triangles_ += placed.batch.triangles.size() / 3;
  caps_ += placed.batch.cap_indices / 3;
}

template <typename ForEach>
void NumberedMesh::findWorld(PlacedBatch& placed, const ForEach& for_each) const {
  const auto find = [&](const WorldPlacement& placement) {
    placed.world.clear();
    for_each([&](std::size_t v) {
      placed.world.push_back(placement.worldPosition(placed.batch, static_cast<std::uint32_t>(v)));
    });
  };
  if (options_.components) {
    placed.values.clear();
    for_each(
        [&](std::size_t v) { placed.values.push_back(static_cast<float>(placed.components[v])); });
  } else if (options_.values != nullptr) {
    find(frame_.placed ? volume_placement_ : placement_);
    placed.values.resize(placed.world.size());
    options_.values->evaluate(placed.world, placed.values);
    if (!frame_.placed) return;
  }
  find(placement_);
}

void NumberedMesh::findVertices(PlacedBatch& placed) const {
  findWorld(placed, [&](const auto& f) { forEachNew(placed, f); });
}

void NumberedMesh::findAllVertices(PlacedBatch& placed) const {
  findWorld(placed, [&](const auto& f) {
    for (std::size_t v = 0; v < placed.batch.positions.size(); ++v) f(v);
  });
}

}  // namespace isobrick
