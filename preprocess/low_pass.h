// One step up the pyramid: level l in, level l+1 out (rule 2 of the design; Sect. 3 of the paper).
#pragma once

#include "storage/format.h"
#include "storage/grid.h"

namespace isobrick {

// How one sample of level l+1 is made along one axis from samples of level l.
struct LowPassTap {
  std::int64_t center = 0;  // index in level l
  bool filtered = false;    // [1 2 1]/4 around `center`, or `center` alone
};

// The tap of coarse sample `i` along `axis`. An axis is filtered only where both neighbours exist
// at their regular distance, 2^level voxels: at the volume's border and beside a clamped last
// sample the value is taken as it is, so that a linear field stays exact on every level.
LowPassTap lowPassTap(const Lattice& lattice, int level, int axis, std::int64_t i);

// Computes slices [first, first + count) of level+1 into `coarse` (its slice `first` comes first,
// lattice.samples(level + 1) in x and y) from the whole of level `level` in `fine`. kSubsample
// takes the samples at even indices as they are. Integer voxels are summed exactly over the three
// axes and rounded once, halves up; float voxels are summed in double (x, then y, then z) and
// rounded once. T: uint8_t, int8_t, uint16_t, int16_t or float. Thread-safe for disjoint output.
template <typename T>
void lowPassSlices(const Lattice& lattice, int level, format::Filter filter, const T* fine,
                   std::int64_t first, std::int64_t count, T* coarse);

}  // namespace isobrick
