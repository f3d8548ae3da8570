// A sample of the lattice edges of level 0, steep ones first, and estimates from it.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "isobrick/preprocess/byte_sequence.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/gradient_spectrum.h"
#include "isobrick/storage/voxel_histogram.h"

namespace isobrick {

// For the edges in every n-th row of every n-th slice, of large volumes from every fourth voxel,
// kEdges are kept: the first ones in the order of a random number, which their place gives, over
// the difference of their two voxels. That is a priority sample (Duffield, Lund and Thorup, 2007),
// from which sums over all edges can be estimated. It depends on the volume alone: not on bricks,
// windows, threads, or the order of calls.
class EdgeSample {
 public:
  static constexpr std::size_t kEdges = 32768;

  // Samples the edges from the voxels of `own` to the next ones along each axis, as far as the
  // volume reaches; `samples` has both. Every voxel of the volume comes once, in any sample.
  template <typename T>
  void add(const SampleBlock<T>& samples, const IndexBox& own, const Index3& volume);
  // Adds another sample, of other voxels.
  void merge(const EdgeSample& other);

  // As bytes, for a merge() elsewhere. False if the bytes are none of a sample.
  void writeTo(ByteSequenceWriter& bytes) const;
  [[nodiscard]] bool readFrom(ByteSequenceReader& bytes);

  // For the volume whose histogram this is. Nothing if no edges were found.
  std::optional<GradientSpectrum> spectrum(const VoxelHistogram& histogram, const ValueRange& range,
                                           const Index3& volume) const;

 private:
  struct Edge {
    float priority;  // the smaller, the sooner it is kept
    std::uint32_t random, axis;
    float least, greatest;
  };

  template <typename T>
  void addRow(const T* from, const T* to, std::int64_t first, std::int64_t count, std::int64_t step,
              std::uint32_t axis, std::uint32_t seed);
  void prune();
  // By priority: an order that does not depend on how they came.
  std::vector<Edge> inOrder() const;

  // The edges whose priority is at most the greatest one kept; more for a while.
  std::vector<Edge> edges_;
  float greatest_kept_ = std::numeric_limits<float>::max();
};

}  // namespace isobrick
