// One step up the pyramid: level l in, level l+1 out (rule 2 of the design; Sect. 3 of the paper).
#pragma once

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/format.h"

namespace isobrick {

// How one sample of level l+1 is made along one axis from samples of level l.
struct LowPassTap {
  std::int64_t center = 0;  // index in level l
  bool filtered = false;    // [1 2 1]/4 around `center`, or `center` alone

  std::int64_t first() const { return center - (filtered ? 1 : 0); }
  std::int64_t last() const { return center + (filtered ? 1 : 0); }
};

// The tap of coarse sample `i` along `axis`. An axis is filtered only if both neighbours exist at
// their regular distance, 2^level voxels: at the volume's border and beside a clamped last sample
// the value is taken as it is, so that a linear field stays exact on every level. kSubsample never
// filters.
LowPassTap lowPassTap(const Lattice& lattice, int level, format::Filter filter, int axis,
                      std::int64_t i);

// The samples of `level` that the samples `coarse` of level + 1 are made from.
IndexBox lowPassSupport(const Lattice& lattice, int level, format::Filter filter,
                        const IndexBox& coarse);

// Computes the samples `coarse` of level + 1 into `out`, dense, x fastest. `fine` holds at least
// lowPassSupport(coarse). Integer voxels are summed exactly over the three axes and rounded once,
// halves up; float voxels are summed in double (a + 2b + c, along z, then y, then x) and rounded
// once. So the result does not depend on how a level is cut into blocks, nor on the instruction set
// of the machine. T: a voxel type. Thread-safe.
// `has_missing`: samples may be NaN. An axis is not filtered at a sample one of whose neighbours is
// NaN, as at the border: so a result is NaN exactly if its centre is, and linear fields stay exact.
template <typename T>
void lowPassBlock(const Lattice& lattice, int level, format::Filter filter,
                  const SampleBlock<T>& fine, const IndexBox& coarse, T* out,
                  bool has_missing = false);

}  // namespace isobrick
