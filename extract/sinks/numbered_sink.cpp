#include "isobrick/extract/sinks/numbered_sink.h"

#include <limits>

#include "isobrick/storage/error.h"

namespace isobrick {

void NumberedSink::begin(const MeshFrame& frame) {
  frame_ = frame;
  double_precision_ = frame.coordinateMagnitudeInVoxels() >= 2048;
  placement_ = WorldPlacement(frame.geometry);
}

void NumberedSink::place(PlacedBatch& placed) {
  numbering_.place(placed);
  if (numbering_.count() > std::numeric_limits<std::uint32_t>::max())
    throw Error("'" + file_.path() +
                    "': a mesh file holds at most 4,294,967,295 vertices; extract a part of the "
                    "surface or a coarser level",
                {.path = file_.path()});
  placed.first_triangle = triangles_;
  triangles_ += placed.batch.triangles.size() / 3;
}

void NumberedSink::findVertices(PlacedBatch& placed) const {
  placed.world.clear();
  placed.world.reserve(newVertices(placed));
  forEachNew(placed, [&](std::size_t v) {
    placed.world.push_back(placement_.worldPosition(placed.batch, static_cast<std::uint32_t>(v)));
  });
  if (options_.values == nullptr) return;
  placed.values.resize(placed.world.size());
  options_.values->evaluate(placed.world, placed.values);
}

}  // namespace isobrick
