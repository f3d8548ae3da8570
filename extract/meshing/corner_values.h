// Rule 6: the value of a lattice point depends on the point alone. Meshers and oracles all use this
// one implementation.
//
// Let m and M be the finest and the coarsest level of the leaves that touch the point. If it lies
// on the lattice of level M, its value is that of level m. Otherwise it hangs on an edge or a face
// of a leaf of level M, and its value is the mean of the ends (weighted, in a thin last cell).
#pragma once

#include <algorithm>
#include <array>

#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/leaf_rows.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// A + w (B - A), between A and B whatever the rounding.
inline double hangingValue(double a, double b, double w) {
  const auto [low, high] = std::minmax(a, b);
  return std::clamp(a + w * (b - a), low, high);
}

// True if sample `i` of `level` along `axis` is one of the next coarser level too.
inline bool isOnCoarserLattice(const Lattice& lattice, int level, int axis, std::int64_t i) {
  return i % 2 == 0 || i << level >= lattice.voxels()[axis] - 1;
}

// The place of sample `i` of `level`, which is not on the coarser lattice, between its neighbours:
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

// The same for a whole face of a coarser leaf: values[j][i] of the samples of `level` from `first`
// on, i along axes[0] and j along axes[1], 0 .. parts of each (1, or 2 if the face is halved). The
// four corners are set; the points between them are filled.
inline void fillFace(const Lattice& lattice, int level, const Index3& first,
                     const std::array<int, 2>& axes, const std::array<int, 2>& parts,
                     float (&values)[3][3]) {
  const auto [b, c] = axes;
  const auto [parts_b, parts_c] = parts;
  const auto between = [](float low, float high, double weight) {
    return hangingValue(static_cast<double>(low), static_cast<double>(high), weight);
  };
  double along_b[2] = {}, along_c[2] = {};  // beside the lower and the higher side of the face
  double weight_b = 1, weight_c = 1;
  if (parts_b == 2) {
    weight_b = hangingWeight(lattice, level, b, first[b] + 1);
    for (int side = 0; side < 2; ++side) {
      float* const row = values[side * parts_c];
      along_b[side] = between(row[0], row[2], weight_b);
      row[1] = static_cast<float>(along_b[side]);
    }
  }
  if (parts_c == 2) {
    weight_c = hangingWeight(lattice, level, c, first[c] + 1);
    for (int side = 0; side < 2; ++side) {
      const int i = side * parts_b;
      along_c[side] = between(values[0][i], values[2][i], weight_c);
      values[1][i] = static_cast<float>(along_c[side]);
    }
  }
  if (parts_b == 2 && parts_c == 2)
    values[1][1] = static_cast<float>(b < c ? hangingValue(along_b[0], along_b[1], weight_c)
                                            : hangingValue(along_c[0], along_c[1], weight_b));
}

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

// valueOnCoarserLeaf() of the brick's own samples.
template <typename T>
float ownValueOnCoarserLeaf(const Lattice& lattice, int level, const Index3& sample,
                            const SampleView<T>& view) {
  // The mean of integers of 16 bits is exact in any order, also that of one of them four times.
  if constexpr (sizeof(T) <= 2) {
    // No branches: which axes are odd changes from corner to corner.
    std::int64_t steps[3];
    bool is_between = true;  // the middle of its neighbours along each odd axis
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t odd = sample[axis] & 1;
      steps[axis] = odd * view.stride(axis);
      is_between &= (odd == 0) | ((sample[axis] + 1) << level < lattice.voxels()[axis]);
    }
    if (is_between) {
      const T* at = view.at(view.offset(sample));
      const std::int64_t a = steps[0] != 0 ? steps[0] : steps[1];
      const std::int64_t b = steps[2] + (steps[0] != 0 ? steps[1] : 0);
      return static_cast<float>(int{at[-a - b]} + at[a - b] + at[b - a] + at[a + b]) * 0.25f;
    }
  }
  return valueOnCoarserLeaf(lattice, level, sample,
                            [&](const Index3& at) { return view.value(at); });
}

// Rule 6 for a sample that is a corner of a leaf: the finest of the leaves that touch it decides,
// unless it hangs on a coarser one. By rule 5 not both a finer and a coarser leaf touch it.
template <typename T>
float cornerValue(const Lattice& lattice, int level, const Index3& sample, bool touches_finer,
                  bool touches_coarser, BrickFamily<T>& family) {
  if (touches_finer) {
    const Index3 fine = finerSample(lattice, level, sample);
    return family.finer(fine).value(fine);
  }
  const SampleView<T>& own = family.own();
  return touches_coarser ? ownValueOnCoarserLeaf(lattice, level, sample, own) : own.value(sample);
}

// The same with the gradient there (rule 12), to `out`.
template <typename T>
void cornerEnd(const Lattice& lattice, int level, const Index3& sample, bool touches_finer,
               bool touches_coarser, BrickFamily<T>& family, EdgeEnd& out) {
  if (touches_finer) {
    const Index3 fine = finerSample(lattice, level, sample);
    family.finer(fine).end(fine, out);
    return;
  }
  const SampleView<T>& own = family.own();
  own.end(sample, out);
  if (touches_coarser) out.value = ownValueOnCoarserLeaf(lattice, level, sample, own);
}

}  // namespace isobrick
