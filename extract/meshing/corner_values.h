// The values of the leaves' corners (rule 6).
#pragma once

#include "isobrick/extract/kernels/hanging_value.h"
#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/leaf_rows.h"

namespace isobrick {

// A lattice point: its value by rule 6, and the sample that its gradient comes from (rule 12).
struct LatticePoint {
  float value = 0;
  int level = 0;     // the finest of the leaves that touch the point
  Index3 sample{0};  // index in that level
};

// A sample of `level` among those of the next finer level.
inline Index3 finerSample(const Lattice& lattice, int level, const Index3& sample) {
  return glm::min(2L * sample, lattice.samples(level - 1) - Index3(1));
}

// Rule 6 for a sample that is a corner of a leaf: the finest of the leaves that touch it decides,
// unless it hangs on a coarser one. By rule 5 not both a finer and a coarser leaf touch it.
template <typename T>
LatticePoint cornerPoint(const Lattice& lattice, int level, const Index3& sample,
                         bool touches_finer, bool touches_coarser, BrickFamily<T>& family) {
  if (touches_finer) {
    const Index3 fine = finerSample(lattice, level, sample);
    return {family.finer(fine).value(fine), level - 1, fine};
  }
  const SampleView<T>& view = family.own();
  if (!touches_coarser) return {view.value(sample), level, sample};
  const auto ownValue = [&](const Index3& at) { return view.value(at); };
  return {valueOnCoarserLeaf(lattice, level, sample, ownValue), level, sample};
}

}  // namespace isobrick
