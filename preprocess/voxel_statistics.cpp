#include "isobrick/preprocess/voxel_statistics.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

namespace isobrick {
namespace {

constexpr std::int64_t kRowsPerLook = 4;  // and slices

// The upper bits of a number that is not negative, in its order, and the least number with them.
constexpr int kDroppedBits = 15;
constexpr std::size_t kMagnitudes = std::size_t{1} << (31 - kDroppedBits);
std::size_t magnitudeKey(float magnitude) {
  return std::bit_cast<std::uint32_t>(magnitude) >> kDroppedBits;
}
float magnitudeOf(std::size_t key) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(key) << kDroppedBits);
}

// Each key is counted in as many places, so that neighbours of one value, which are frequent, do
// not wait for each other.
constexpr std::size_t kLanes = 2;

std::size_t keysOf(std::size_t voxel_bytes) {
  return voxel_bytes == 1 ? 256 : VoxelHistogram::kMostBins;
}

// The counts that are not zero, with their places.
void writeCounts(const std::vector<std::uint64_t>& counts, ByteSequenceWriter& bytes) {
  std::vector<std::uint32_t> places;
  std::vector<std::uint64_t> values;
  for (std::size_t i = 0; i < counts.size(); ++i)
    if (counts[i] > 0) {
      places.push_back(static_cast<std::uint32_t>(i));
      values.push_back(counts[i]);
    }
  bytes.add(std::span<const std::uint32_t>(places));
  bytes.add(std::span<const std::uint64_t>(values));
}
bool includeCounts(ByteSequenceReader& bytes, std::vector<std::uint64_t>& counts) {
  constexpr std::uint64_t kMostVoxels = std::uint64_t{1} << 57;
  const auto places = bytes.take<std::uint32_t>();
  const auto values = bytes.take<std::uint64_t>();
  if (!bytes.isSound() || places.size() != values.size()) return false;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i] >= counts.size() || values[i] > kMostVoxels ||
        counts[places[i]] > kMostVoxels - values[i])
      return false;
    counts[places[i]] += values[i];
  }
  return true;
}

template <typename T>
void countRow(const T* row, std::int64_t count, std::uint64_t* keys) {
  // Background that was cut off comes in runs.
  constexpr std::int64_t kRun = 16 / sizeof(T);
  std::int64_t x = 0;
  while (x + kRun <= count) {
    if (std::memcmp(row + x, row + x + 1, 16 - sizeof(T)) == 0) {
      keys[kLanes * histogramKey(row[x])] += kRun;
      x += kRun;
      continue;
    }
    for (const std::int64_t end = x + kRun; x < end; x += kLanes)
      for (std::size_t lane = 0; lane < kLanes; ++lane)
        ++keys[kLanes * histogramKey(row[x + static_cast<std::int64_t>(lane)]) + lane];
  }
  for (; x < count; ++x) ++keys[kLanes * histogramKey(row[x])];
}

}  // namespace

template <typename T>
void VoxelStatistics::add(const SampleBlock<T>& samples, const IndexBox& own,
                          const Index3& volume) {
  Counts& counts = counts_.local();
  counts.edges.add(samples, own, volume);
  counts.keys.resize(kLanes * keysOf(sizeof(T)));
  counts.magnitudes.resize(kMagnitudes);
  const Index3 end = own.end();
  for (std::int64_t z = own.first.z; z < end.z; ++z)
    for (std::int64_t y = own.first.y; y < end.y; ++y) {
      const T* const row = &samples.at({own.first.x, y, z});
      countRow(row, own.count.x, counts.keys.data());
      if (y % kRowsPerLook != 0 || z % kRowsPerLook != 0) continue;
      const std::int64_t begin = std::max<std::int64_t>(own.first.x, 1);
      for (std::int64_t x = begin; x < std::min(end.x, volume.x - 1); ++x) {
        const T* const at = row + (x - own.first.x);
        const auto a = static_cast<float>(at[-1]), b = static_cast<float>(at[0]),
                   c = static_cast<float>(at[1]);
        if (a != a || b != b || c != c) continue;  // no data
        if (a != b || b != c) ++counts.magnitudes[magnitudeKey(std::abs((a - b) - (b - c)))];
      }
    }
}
#define ISOBRICK_INSTANTIATE(T) \
  template void VoxelStatistics::add<T>(const SampleBlock<T>&, const IndexBox&, const Index3&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

std::vector<std::uint64_t> VoxelStatistics::sumOf(
    const tbb::enumerable_thread_specific<Counts>& counts,
    std::vector<std::uint64_t> Counts::*which) {
  std::vector<std::uint64_t> sums;
  for (const Counts& some : counts) {
    sums.resize((some.*which).size());
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += (some.*which)[i];
  }
  return sums;
}

VoxelHistogram VoxelStatistics::histogram(VoxelType type, const ValueRange& range) const {
  VoxelHistogram histogram(type, range);
  const std::vector<std::uint64_t> sums = sumOf(counts_, &Counts::keys);
  const auto first = visitVoxelType(type, [&](auto tag) {
    return histogramKey(static_cast<typename decltype(tag)::Type>(range.min));
  });
  for (std::size_t i = 0; i < histogram.bins(); ++i)
    for (std::size_t lane = 0; lane < kLanes; ++lane)
      histogram.counts()[i] += sums[kLanes * (first + i) + lane];
  return histogram;
}

std::optional<GradientSpectrum> VoxelStatistics::gradients(const VoxelHistogram& histogram,
                                                           const ValueRange& range,
                                                           const Index3& volume) const {
  return allEdges().spectrum(histogram, range, volume);
}

EdgeSample VoxelStatistics::allEdges() const {
  EdgeSample all;
  for (const Counts& some : counts_) all.merge(some.edges);
  return all;
}

void VoxelStatistics::writeTo(ByteSequenceWriter& bytes) const {
  allEdges().writeTo(bytes);
  writeCounts(sumOf(counts_, &Counts::keys), bytes);
  writeCounts(sumOf(counts_, &Counts::magnitudes), bytes);
}

bool VoxelStatistics::include(VoxelType type, ByteSequenceReader& bytes) {
  Counts& counts = counts_.local();
  counts.keys.resize(kLanes * keysOf(voxelBytes(type)));
  counts.magnitudes.resize(kMagnitudes);
  EdgeSample edges;
  if (!edges.readFrom(bytes)) return false;
  counts.edges.merge(edges);
  return includeCounts(bytes, counts.keys) && includeCounts(bytes, counts.magnitudes);
}

double VoxelStatistics::noise() const {
  const std::vector<std::uint64_t> sums = sumOf(counts_, &Counts::magnitudes);
  const std::uint64_t all = std::accumulate(sums.begin(), sums.end(), std::uint64_t{0});
  if (all == 0) return 0;
  std::uint64_t before = 0;
  std::size_t key = 0;
  while (before + sums[key] <= all / 2) before += sums[key++];
  const float median = std::min(magnitudeOf(key), std::numeric_limits<float>::max());
  return static_cast<double>(median) / (0.6745 * std::sqrt(6.0));
}

}  // namespace isobrick
