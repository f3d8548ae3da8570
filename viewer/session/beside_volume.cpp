#include "isobrick/viewer/session/beside_volume.h"

#include <algorithm>
#include <memory>

#include "isobrick/viewer/stream/listed_components.h"
#include "isobrick/viewer/stream/moved_chunk.h"

namespace isobrick {
namespace {

ChunkDelivery into(const SceneLattice& scene, const SceneLattice& own) {
  ChunkDelivery delivery;
  if (own != scene) delivery.pack = [=](SurfaceChunk& chunk) { moveChunk(chunk, own, scene); };
  return delivery;
}

}  // namespace

BesideVolume::BesideVolume(const OpenedVolume& opened, int number, const SceneLattice& scene,
                           const OpenMasks& masks, ChunkStore& store, const ChunkBudget& budget,
                           int threads)
    : number_(number),
      shown_(opened.file, std::nullopt, opened.histogram.isovalues, masks),
      histogram_(opened.histogram),
      requests_(shown_, histogram_, store, budget, threads, std::make_shared<KnownComponents>(), {},
                into(scene, shown_.lattice())) {}

SurfaceWish BesideVolume::wishOf(const ViewState& state, const ViewVolume& first,
                                 double height) const {
  const GridGeometry &from = first.geometry, &to = volume().geometry;
  ViewState own = state;
  own.focus.center = to.worldToIndex(from.indexToWorld(state.focus.center));
  own.focus.radius = state.focus.radius * from.leastSpacing() / to.leastSpacing();
  // Values of vertices mean another thing in each volume; without them surfaces have their colours.
  own.coloring = ViewColoring::kPlain;
  for (ViewSurface& surface : own.surfaces) {
    surface.visible = surface.visible && surface.volume == number_;
    surface.pieces = {};
  }
  SurfaceWish wish = shown_.wishOf(own, height);
  wish.is_whole = state.focus.everywhere;
  return wish;
}

void BesideVolume::bound(ViewState& state) const {
  for (ViewSurface& surface : state.surfaces)
    if (surface.volume == number_)
      surface.isovalue =
          std::clamp(surface.isovalue, volume().least_value, volume().greatest_value);
}

void BesideVolume::addTo(SessionStatus& status) const {
  status.triangles += requests_.shown().triangles();
  status.shown_bytes += requests_.chunkBytes();
  if (!requests_.error().empty()) status.error = requests_.error();
}

}  // namespace isobrick
