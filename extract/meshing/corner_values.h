// The values of the leaves' corners (rule 6).
#pragma once

#include <vector>

#include "isobrick/extract/kernels/hanging_value.h"
#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/tile_leaves.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

// A lattice point: its value by rule 6, and the sample that its gradient comes from (rule 12).
struct LatticePoint {
  float value = 0;
  int level = 0;     // the finest of the leaves that touch the point
  Index3 sample{0};  // index in that level
};

// The corners of a tile's cells.
struct TileCorners {
  IndexBox samples;                  // of the tile's level
  std::vector<LatticePoint> points;  // x fastest; only corners of leaves are filled

  const LatticePoint& at(const Index3& sample) const {
    return points[static_cast<std::size_t>(linearIndex(sample - samples.first, samples.count))];
  }
};

// Rule 6 for a sample that is a corner of a leaf, touched by cells of these states: the finest of
// the leaves that touch it decides, unless it hangs on a coarser one.
template <typename T>
LatticePoint cornerPoint(const Lattice& lattice, int level, const Index3& sample, StateSet touching,
                         BrickFamily<T>& family) {
  if (touching.has(CellState::kFiner)) {
    const Index3 fine = glm::min(2L * sample, lattice.samples(level - 1) - Index3(1));
    return {family.finer(fine).value(fine), level - 1, fine};
  }
  const SampleView<T>& view = family.own();
  if (!touching.has(CellState::kCoarser)) return {view.value(sample), level, sample};
  const auto ownValue = [&](const Index3& at) { return view.value(at); };
  return {valueOnCoarserLeaf(lattice, level, sample, ownValue), level, sample};
}

// Fills `out` for the corners of all leaves of the tile, and keeps its memory.
template <typename T>
void resolveCorners(const Lattice& lattice, const TileLeaves& leaves, BrickFamily<T>& family,
                    TileCorners& out) {
  out.samples = {leaves.cells.first, leaves.cells.count + Index3(1)};
  out.points.resize(static_cast<std::size_t>(out.samples.size()));
  LatticePoint* point = out.points.data();
  if (leaves.all_leaves) {
    const SampleView<T>& view = family.own();
    forEachIndex(out.samples, [&](const Index3& sample) {
      *point++ = {view.value(sample), leaves.level, sample};
    });
    return;
  }
  forEachIndex(out.samples, [&](const Index3& sample) {
    const StateSet touching = leaves.statesAround(sample);
    if (touching.has(CellState::kLeaf))
      *point = cornerPoint(lattice, leaves.level, sample, touching, family);
    ++point;
  });
}

}  // namespace isobrick
