// Statistics of the voxels of level 0 while a pyramid is built: their values,
// their noise, and how steep they are (edge_sample.h).
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "isobrick/preprocess/edge_sample.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/voxel_histogram.h"

namespace isobrick {

// The noise is the standard deviation of noise that is independent from voxel to voxel, in the
// units of the voxels: the median of the magnitudes of the second differences along x, which are
// small in a smooth field, over 0.6745 sqrt(6), as for Gaussian noise. Triples of equal voxels do
// not count: they are background that was cut off, or saturated. 0 if all are such. Surfaces, which
// are few, hardly move a median; noise that a filter has smeared over several voxels is
// underestimated. It reads every fourth row of every fourth slice, and magnitudes to 1/256 of their
// value.
class VoxelStatistics {
 public:
  // Counts the voxels of `own`, with `samples` around it: one more along each axis if the volume,
  // of `volume` voxels, has it. Thread-safe. Every voxel is to be counted once; their order does
  // not matter.
  template <typename T>
  void add(const SampleBlock<T>& samples, const IndexBox& own, const Index3& volume);

  // For all voxels that were counted, which have that range. Not while others count.
  VoxelHistogram histogram(VoxelType type, const ValueRange& range) const;
  double noise() const;
  // Nothing if all voxels are equal.
  std::optional<GradientSpectrum> gradients(const VoxelHistogram& histogram,
                                            const ValueRange& range, const Index3& volume) const;

  // All that was counted, as bytes, for another object; not while others count. include() adds it
  // there; false if these are none of voxels of that type.
  void writeTo(ByteSequenceWriter& bytes) const;
  [[nodiscard]] bool include(VoxelType type, ByteSequenceReader& bytes);

 private:
  struct Counts {
    EdgeSample edges;
    std::vector<std::uint64_t> keys, magnitudes;  // of a key some counts side by side
  };
  EdgeSample allEdges() const;
  static std::vector<std::uint64_t> sumOf(const tbb::enumerable_thread_specific<Counts>& counts,
                                          std::vector<std::uint64_t> Counts::*which);

  tbb::enumerable_thread_specific<Counts> counts_;
};

}  // namespace isobrick
