#include "isobrick/extract/sinks/numbered_sink.h"

#include <limits>

#include "isobrick/extract/pyramid_values.h"
#include "isobrick/storage/error.h"

namespace isobrick {

void NumberedSink::begin(const MeshFrame& frame) {
  frame_ = frame;
  frame_.geometry.origin += options_.shift;
  double_precision_ = frame_.coordinateMagnitudeInVoxels() >= 2048;
  placement_ = WorldPlacement(frame_.geometry);
}

void NumberedSink::place(PlacedBatch& placed) {
  if (options_.components && placed.components.size() != placed.batch.positions.size())
    throw Error("'" + file_.path() +
                    "': the vertices have no numbers of components; put a ComponentFilter or a "
                    "ComponentNumbering before the file",
                {.path = file_.path()});
  numbering_.place(placed);
  if (numbering_.count() > std::numeric_limits<std::uint32_t>::max())
    throw Error("'" + file_.path() +
                    "': a mesh file holds at most 4,294,967,295 vertices; extract a part of the "
                    "surface or a coarser level",
                {.path = file_.path()});
  placed.first_triangle = triangles_;
  placed.first_cap = caps_;
  triangles_ += placed.batch.triangles.size() / 3;
  caps_ += placed.batch.cap_indices / 3;
}

void NumberedSink::findVertices(PlacedBatch& placed) const {
  placed.world.clear();
  placed.world.reserve(newVertices(placed));
  forEachNew(placed, [&](std::size_t v) {
    placed.world.push_back(placement_.worldPosition(placed.batch, static_cast<std::uint32_t>(v)));
  });
  findValues(placed);
  if (!options_.components) return;
  placed.values.clear();
  forEachNew(placed, [&](std::size_t v) { placed.values.push_back(componentValue(placed, v)); });
}

void NumberedSink::findAllVertices(PlacedBatch& placed) const {
  const std::size_t count = placed.batch.positions.size();
  placed.world.resize(count);
  for (std::size_t v = 0; v < count; ++v)
    placed.world[v] = placement_.worldPosition(placed.batch, static_cast<std::uint32_t>(v));
  findValues(placed);
  if (!options_.components) return;
  placed.values.resize(count);
  for (std::size_t v = 0; v < count; ++v) placed.values[v] = componentValue(placed, v);
}

void NumberedSink::findValues(PlacedBatch& placed) const {
  if (options_.values == nullptr) return;
  placed.values.resize(placed.world.size());
  if (options_.shift == glm::dvec3(0.0)) {
    options_.values->evaluate(placed.world, placed.values);
    return;
  }
  std::vector<glm::dvec3> unshifted = placed.world;
  for (glm::dvec3& place : unshifted) place -= options_.shift;
  options_.values->evaluate(unshifted, placed.values);
}

}  // namespace isobrick
