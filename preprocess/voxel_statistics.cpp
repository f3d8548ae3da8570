#include "isobrick/preprocess/voxel_statistics.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <tuple>

namespace isobrick {
namespace {

// The voxels that are sampled: those whose indices are multiples of these. Small volumes have few.
struct EdgeSteps {
  std::int64_t column, row;  // and slice
};
EdgeSteps edgeStepsOf(const Index3& volume) {
  const std::int64_t voxels = elementCount(volume);
  if (voxels <= std::int64_t{1} << 18) return {1, 1};
  if (voxels <= std::int64_t{1} << 21) return {1, 2};
  return {4, 4};
}

float differenceOf(float a, float b) {
  return std::min(std::abs(a - b), std::numeric_limits<float>::max());
}

// After the finalizer of MurmurHash3.
std::uint32_t mixed(std::uint32_t h) {
  h ^= h >> 16;
  h *= 0x85ebca6bu;
  h ^= h >> 13;
  h *= 0xc2b2ae35u;
  return h ^ h >> 16;
}

// The values that get parts: all but a far least or greatest voxel, such as padding has, and the
// last ten-thousandth of the others at both ends.
ValueRange spectrumRange(const VoxelHistogram& histogram, const ValueRange& range) {
  constexpr std::uint64_t kOutliers = 10000;
  const auto counts = histogram.counts();
  std::uint64_t others = 0;
  for (std::size_t i = 1; i + 1 < counts.size(); ++i) others += counts[i];
  if (others == 0) return range;
  std::size_t low = 1, high = counts.size() - 2;
  for (std::uint64_t before = counts[low]; before <= others / kOutliers;) before += counts[++low];
  for (std::uint64_t after = counts[high]; after <= others / kOutliers;) after += counts[--high];
  ValueRange inner{std::max(histogram.bin(low).min, range.min),
                   std::min(histogram.bin(high).max, range.max)};
  const double span = static_cast<double>(inner.max) - static_cast<double>(inner.min);
  const auto isNear = [&](float value, float end) {
    return std::abs(static_cast<double>(value) - static_cast<double>(end)) <= span;
  };
  const ValueRange all{isNear(inner.min, range.min) ? range.min : inner.min,
                       isNear(inner.max, range.max) ? range.max : inner.max};
  return all.max > all.min ? all : range;
}

// Whether the least voxel is further from the next values than the greatest is.
bool isLeastFurther(const VoxelHistogram& histogram, const ValueRange& range) {
  const auto counts = histogram.counts();
  std::size_t low = 1, high = counts.size() - 1;
  while (low < counts.size() && counts[low] == 0) ++low;
  while (high-- > 0 && counts[high] == 0) continue;
  if (low == counts.size() || high == 0) return true;
  return static_cast<double>(histogram.bin(low).min) - static_cast<double>(range.min) >=
         static_cast<double>(range.max) - static_cast<double>(histogram.bin(high).max);
}

// Sums over edges by the values that they cross: each adds a share to every part that it touches.
class PartSums {
 public:
  PartSums(std::size_t parts, double first, double width)
      : first_(first), width_(width), sums_(parts, 0.0), steps_(parts + 1, 0.0) {}

  void add(double least, double greatest, double weight) {
    const auto end = static_cast<double>(sums_.size());
    const double from = std::clamp((least - first_) / width_, 0.0, end);
    const double to = std::clamp((greatest - first_) / width_, 0.0, end);
    if (!(to > from)) return;
    const auto begin_part = std::min(static_cast<std::size_t>(from), sums_.size() - 1);
    const auto end_part = std::min(static_cast<std::size_t>(to), sums_.size() - 1);
    if (begin_part == end_part) {
      sums_[begin_part] += weight * (to - from);
      return;
    }
    sums_[begin_part] += weight * (static_cast<double>(begin_part) + 1 - from);
    sums_[end_part] += weight * (to - static_cast<double>(end_part));
    steps_[begin_part + 1] += weight;  // the whole of those between
    steps_[end_part] -= weight;
  }

  std::vector<float> sums() const {
    std::vector<float> result;
    double whole = 0;
    for (std::size_t i = 0; i < sums_.size(); ++i) {
      whole += steps_[i];
      const double sum = std::max(whole + sums_[i], 0.0);
      result.push_back(static_cast<float>(
          std::min(sum, static_cast<double>(std::numeric_limits<float>::max()))));
    }
    return result;
  }

 private:
  double first_, width_;
  std::vector<double> sums_, steps_;
};

}  // namespace

template <typename T>
void EdgeSample::addRow(const T* from, const T* to, std::int64_t first, std::int64_t count,
                        std::int64_t step, std::uint32_t axis, std::uint32_t seed) {
  for (std::int64_t x = (step - first % step) % step; x < count; x += step) {
    if (from[x] == to[x]) continue;
    const auto a = static_cast<float>(from[x]), b = static_cast<float>(to[x]);
    constexpr int kDropped = 8;  // the remaining bits are a float without rounding, and above 0
    const std::uint32_t random =
        (mixed(seed + static_cast<std::uint32_t>(first + x) * 0x9e3779b1u) >> kDropped) + 1;
    // Nearly all end here, without a division; NaN too.
    constexpr float kRounding = 1.00001f;
    if (!(static_cast<float>(random) <= kRounding * greatest_kept_ * std::abs(a - b))) continue;
    const float priority = static_cast<float>(random) / differenceOf(a, b);
    if (priority > greatest_kept_) continue;
    edges_.push_back({priority, random, axis, std::min(a, b), std::max(a, b)});
    if (edges_.size() >= 2 * kEdges) prune();
  }
}

template <typename T>
void EdgeSample::add(const SampleBlock<T>& samples, const IndexBox& own, const Index3& volume) {
  const EdgeSteps step = edgeStepsOf(volume);
  const Index3 begin = (own.first + (step.row - 1)) / step.row * step.row, end = own.end();
  for (std::int64_t z = begin.z; z < end.z; z += step.row)
    for (std::int64_t y = begin.y; y < end.y; y += step.row) {
      const std::int64_t x = own.first.x, along_x = std::min(end.x, volume.x - 1) - x;
      const Index3 at(x, y, z);
      const T* const row = &samples.at(at);
      const auto seed = mixed(static_cast<std::uint32_t>(y) * 0x85ebca77u +
                              mixed(static_cast<std::uint32_t>(z) * 0xc2b2ae3du + 1));
      addRow(row, row + 1, x, along_x, step.column, 0, seed);
      if (y + 1 < volume.y)
        addRow(row, &samples.at(at + Index3(0, 1, 0)), x, own.count.x, step.column, 1, ~seed);
      if (z + 1 < volume.z)
        addRow(row, &samples.at(at + Index3(0, 0, 1)), x, own.count.x, step.column, 2, mixed(seed));
    }
}
#define ISOBRICK_INSTANTIATE(T) \
  template void EdgeSample::add<T>(const SampleBlock<T>&, const IndexBox&, const Index3&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

void EdgeSample::prune() {
  if (edges_.size() <= kEdges) return;
  const auto last = edges_.begin() + kEdges;
  std::nth_element(edges_.begin(), last, edges_.end(),
                   [](const Edge& a, const Edge& b) { return a.priority < b.priority; });
  greatest_kept_ = last->priority;
  std::erase_if(edges_, [&](const Edge& edge) { return edge.priority > greatest_kept_; });
}

void EdgeSample::merge(const EdgeSample& other) {
  greatest_kept_ = std::min(greatest_kept_, other.greatest_kept_);
  edges_.insert(edges_.end(), other.edges_.begin(), other.edges_.end());
  prune();
}

std::vector<EdgeSample::Edge> EdgeSample::inOrder() const {
  std::vector<Edge> edges = edges_;
  const auto key = [](const Edge& e) { return std::tuple(e.random, e.axis, e.least, e.greatest); };
  std::sort(edges.begin(), edges.end(), [&](const Edge& a, const Edge& b) {
    return a.priority != b.priority ? a.priority < b.priority : key(a) < key(b);
  });
  return edges;
}

void EdgeSample::writeTo(ByteSequenceWriter& bytes) const {
  std::vector<std::uint32_t> whole;
  std::vector<float> values;
  for (const Edge& edge : inOrder()) {
    whole.insert(whole.end(), {edge.random, edge.axis});
    values.insert(values.end(), {edge.least, edge.greatest});
  }
  bytes.add(std::span<const std::uint32_t>(whole));
  bytes.add(std::span<const float>(values));
  bytes.add(std::span<const float>(&greatest_kept_, 1));
}

bool EdgeSample::readFrom(ByteSequenceReader& bytes) {
  const auto whole = bytes.take<std::uint32_t>();
  const auto values = bytes.take<float>();
  const auto greatest = bytes.take<float>();
  if (!bytes.isSound() || whole.size() != values.size() || whole.size() % 2 != 0 ||
      whole.size() > 4 * kEdges || greatest.size() != 1 || !(greatest[0] > 0))
    return false;
  edges_.clear();
  greatest_kept_ = greatest[0];
  for (std::size_t i = 0; i < whole.size(); i += 2) {
    const std::uint32_t random = whole[i], axis = whole[i + 1];
    const float least = values[i], most = values[i + 1];
    if (random == 0 || random > std::uint32_t{1} << 24 || axis > 2 || !(least < most) ||
        !std::isfinite(least) || !std::isfinite(most))
      return false;
    edges_.push_back(
        {static_cast<float>(random) / differenceOf(least, most), random, axis, least, most});
  }
  return true;
}

std::optional<GradientSpectrum> EdgeSample::spectrum(const VoxelHistogram& histogram,
                                                     const ValueRange& range,
                                                     const Index3& volume) const {
  std::vector<Edge> edges = inOrder();  // so that sums of doubles are the same
  // Edges with a priority below that of the first one left out also stand for the edges left out.
  double reach = std::numeric_limits<double>::infinity();
  if (edges.size() > kEdges) {
    reach = static_cast<double>(edges[kEdges].priority);
    edges.resize(kEdges);
  }
  if (edges.empty()) return std::nullopt;

  const ValueRange values = spectrumRange(histogram, range);
  const std::size_t parts = gradientParts(volume);
  GradientSpectrum spectrum;
  spectrum.first = values.min;
  spectrum.width =
      static_cast<float>((static_cast<double>(values.max) - static_cast<double>(values.min)) /
                         static_cast<double>(parts));
  if (!std::isfinite(spectrum.width) || values.min + spectrum.width == values.min)
    return std::nullopt;
  struct Sums {
    PartSums area, gradient;
  };
  const PartSums none(parts, static_cast<double>(spectrum.first),
                      static_cast<double>(spectrum.width));
  std::array<Sums, 3> groups{Sums{none, none}, Sums{none, none}, Sums{none, none}};
  const std::size_t of_both = isLeastFurther(histogram, range) ? 1 : 2;
  std::array<double, 3> at_least{}, at_greatest{};
  const EdgeSteps step = edgeStepsOf(volume);
  const auto looked_at = 1.0 / static_cast<double>(step.column * step.row * step.row);
  for (const Edge& edge : edges) {
    const auto difference = static_cast<double>(differenceOf(edge.least, edge.greatest));
    const double seen = std::min(1.0, reach * difference * 0x1p-24);  // how probably it is kept
    const double weight = 1.0 / (seen * looked_at);
    const bool is_least = edge.least == range.min, is_greatest = edge.greatest == range.max;
    if (is_least) at_least[edge.axis] += weight;
    if (is_greatest) at_greatest[edge.axis] += weight;
    const bool is_both = is_least && is_greatest;
    Sums& group = groups[is_both ? of_both : is_least ? 1 : is_greatest ? 2 : 0];
    const auto least = static_cast<double>(edge.least),
               greatest = static_cast<double>(edge.greatest);
    group.area.add(least, greatest, weight);
    group.gradient.add(least, greatest, weight * difference);
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    spectrum.at_least[axis] = static_cast<float>(at_least[axis]);
    spectrum.at_greatest[axis] = static_cast<float>(at_greatest[axis]);
  }
  spectrum.inner = {groups[0].area.sums(), groups[0].gradient.sums()};
  spectrum.least = {groups[1].area.sums(), groups[1].gradient.sums()};
  spectrum.greatest = {groups[2].area.sums(), groups[2].gradient.sums()};
  return spectrum;
}

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
