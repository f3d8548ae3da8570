// Statistics of the voxels of level 0 while a pyramid is built: their values, their noise, and how
// steep they are; and the same as bytes.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/gradient_spectrum.h"
#include "isobrick/storage/voxel_histogram.h"

namespace isobrick {

// Appends arrays of numbers, or of structs of them without padding, each with its length.
class ByteSequenceWriter {
 public:
  template <typename T>
  void add(std::span<const T> items) {
    static_assert(std::has_unique_object_representations_v<T> || std::is_floating_point_v<T>);
    const std::uint64_t count = items.size();
    append(&count, sizeof count);
    append(items.data(), items.size_bytes());
  }
  std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  void append(const void* data, std::size_t bytes) {
    const std::size_t end = bytes_.size();
    bytes_.resize(end + bytes);
    if (bytes > 0) std::memcpy(bytes_.data() + end, data, bytes);
  }
  std::vector<std::byte> bytes_;
};

// Reads them again. Safe with any bytes: what is not there is empty, and isSound() is false then.
class ByteSequenceReader {
 public:
  explicit ByteSequenceReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <typename T>
  std::vector<T> take() {
    std::uint64_t count = 0;
    if (bytes_.size() < sizeof count) return refuse<T>();
    std::memcpy(&count, bytes_.data(), sizeof count);
    bytes_ = bytes_.subspan(sizeof count);
    if (count > bytes_.size() / sizeof(T)) return refuse<T>();
    std::vector<T> items(count);
    if (count > 0) std::memcpy(items.data(), bytes_.data(), count * sizeof(T));
    bytes_ = bytes_.subspan(count * sizeof(T));
    return items;
  }
  // Whether all was there so far.
  bool isSound() const { return is_sound_; }
  bool isAtEnd() const { return bytes_.empty(); }

 private:
  template <typename T>
  std::vector<T> refuse() {
    is_sound_ = false;
    bytes_ = {};
    return {};
  }
  std::span<const std::byte> bytes_;
  bool is_sound_ = true;
};

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
