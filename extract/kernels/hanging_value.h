// Values of lattice points that a coarser leaf touches (rule 6).
#pragma once

#include <algorithm>

#include "isobrick/storage/grid.h"

namespace isobrick {

// A + w (B - A), between A and B whatever the rounding.
inline double hangingValue(double a, double b, double w) {
  const auto [low, high] = std::minmax(a, b);
  return std::clamp(a + w * (b - a), low, high);
}

// True where sample `i` of `level` along `axis` is one of the next coarser level too.
inline bool isOnCoarserLattice(const Lattice& lattice, int level, int axis, std::int64_t i) {
  return i % 2 == 0 || i << level >= lattice.voxels()[axis] - 1;
}

// Where sample `i` of `level`, one that is not on the coarser lattice, lies between its neighbours:
// 1/2, but for a thin last cell.
inline double hangingWeight(const Lattice& lattice, int level, int axis, std::int64_t i) {
  if ((i + 1) << level <= lattice.voxels()[axis] - 1) return 0.5;  // most: divisions are slow
  const auto low = static_cast<double>(lattice.position(level, axis, i - 1));
  const auto middle = static_cast<double>(lattice.position(level, axis, i));
  const auto high = static_cast<double>(lattice.position(level, axis, i + 1));
  return (middle - low) / (high - low);
}

// The value of a sample of `level` that touches a coarser leaf. On the coarser lattice it is
// valueAt(sample). Else the sample hangs on that leaf's edge or face (it cannot lie inside), and
// its value is interpolated from that of the two or four ends, along the lower axis first: the one
// order that all sides of the edge or face take. `valueAt` takes a sample of `level` that is on the
// coarser lattice and returns a float.
template <typename F>
float valueOnCoarserLeaf(const Lattice& lattice, int level, const Index3& sample, F&& valueAt) {
  int odd[3];
  int odd_axes = 0;
  for (int axis = 0; axis < 3; ++axis)
    if (!isOnCoarserLattice(lattice, level, axis, sample[axis])) odd[odd_axes++] = axis;
  if (odd_axes == 0) return valueAt(sample);

  const auto alongFirst = [&](Index3 at) {
    const int axis = odd[0];
    --at[axis];
    const auto low = static_cast<double>(valueAt(at));
    at[axis] += 2;
    return hangingValue(low, static_cast<double>(valueAt(at)),
                        hangingWeight(lattice, level, axis, sample[axis]));
  };
  if (odd_axes == 1) return static_cast<float>(alongFirst(sample));

  Index3 low = sample, high = sample;
  --low[odd[1]];
  ++high[odd[1]];
  return static_cast<float>(hangingValue(alongFirst(low), alongFirst(high),
                                         hangingWeight(lattice, level, odd[1], sample[odd[1]])));
}

}  // namespace isobrick
