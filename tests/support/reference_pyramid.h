// The pyramid of rules 1 and 2, built slowly: the oracle that `preprocess` is tested against and
// the input of the reference mesher. Independent of every other part of isobrick but the lattice
// and the voxel types.
//
//   std::vector<std::uint8_t> voxels = ...;                       // x fastest, then y, then z
//   ReferencePyramid pyramid = buildReferencePyramid<std::uint8_t>(dims, voxels);
//   float v = pyramid.sampleAt(2, {1, 0, 3});                     // sample (1,0,3) of level 2
#pragma once

#include <span>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick::test {

enum class ReferenceFilter { kAverage, kSubsample };

// All levels of one volume as floats (exact for the integer voxel types), each level dense with x
// fastest; level l holds lattice.samples(l) values.
struct ReferencePyramid {
  Lattice lattice;
  std::vector<std::vector<float>> levels;
  // NaN is a voxel without data: leaves beside one make nothing, gradients there are one-sided.
  bool has_missing = false;

  float sampleAt(int level, const Index3& sample) const;
  // The sample of `level` that sits at voxel index `position`, which must be on its lattice.
  float sampleAtPosition(int level, const Index3& position) const;
};

// True when `position` is on the lattice of `level` along `axis`: a multiple of 2^level or the last
// voxel. Lattice points are identified by their clamped positions.
bool isOnLattice(const Lattice& lattice, int level, int axis, std::int64_t position);
bool isOnLattice(const Lattice& lattice, int level, const Index3& position);

// Index of the sample of `level` at a position that is on its lattice along `axis`. The last voxel
// is always the last sample.
std::int64_t sampleIndex(const Lattice& lattice, int level, int axis, std::int64_t position);
Index3 sampleIndex(const Lattice& lattice, int level, const Index3& position);

// Builds every level from level 0. T is one of the five voxel types; `voxels` holds
// elementCount(dims) values, dims >= 2 per axis. Throws std::invalid_argument otherwise.
//
// kAverage, sample i of level l+1, each axis on its own: [1 2 1]/4 around sample 2i of level l when
// both neighbours exist and neither was clamped to the last voxel; else that axis is not filtered,
// and a sample past the last is the last. With k filtered axes and total weight W = 4^k:
// integers floor((sum + W/2) / W); floats one double sum, divided by W, rounded once.
template <typename T>
ReferencePyramid buildReferencePyramid(const Index3& dims, std::span<const T> voxels,
                                       ReferenceFilter filter = ReferenceFilter::kAverage);

}  // namespace isobrick::test
