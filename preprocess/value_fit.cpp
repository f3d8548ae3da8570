#include "isobrick/preprocess/value_fit.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

constexpr std::size_t kBytesAtATime = std::size_t{1}
                                      << 20;  // of numbers that become voxels at once
constexpr std::int64_t kMostScannedVoxels = std::int64_t{1} << 16;

// Holds a number and its difference from any double near it.
template <typename In>
using Exact = std::conditional_t<sizeof(In) == 8 && std::is_integral_v<In>, long double, double>;

template <typename In>
Exact<In> storedOf(In value, const ValueTransform& values) {
  return (static_cast<Exact<In>>(value) - static_cast<Exact<In>>(values.offset)) /
         static_cast<Exact<In>>(values.scale);
}

// How far the value that a reader of float32 finds is from the number.
template <typename In>
double roundingOf(In value, const ValueTransform& values) {
  using Wide = Exact<In>;
  const auto found = static_cast<Wide>(static_cast<float>(storedOf(value, values))) *
                         static_cast<Wide>(values.scale) +
                     static_cast<Wide>(values.offset);
  return static_cast<double>(std::abs(found - static_cast<Wide>(value)));
}

// False for NaN, infinity, and what is too large for float32: finite_voxels.h has these.
bool isForFloats(double value) {
  return std::abs(value) <= static_cast<double>(std::numeric_limits<float>::max());
}

// Facts of the other numbers of a volume, or of a part of it.
template <typename In>
struct Census {
  In least = std::numeric_limits<In>::max(), greatest = std::numeric_limits<In>::lowest();
  std::uint64_t changed = 0;  // by being float32 around the transform that was tried
  double most_change = 0;
  std::uint64_t changed_plain = 0;  // by being float32 as they are
  std::vector<In> samples;

  void add(const In* numbers, std::int64_t count, std::int64_t first, std::int64_t step,
           const ValueTransform& tried) {
    for (std::int64_t i = 0; i < count; ++i) {
      const In value = numbers[i];
      if constexpr (std::is_floating_point_v<In>)
        if (!isForFloats(value)) continue;
      least = std::min(least, value);
      greatest = std::max(greatest, value);
      const double change = roundingOf(value, tried);
      changed += change > 0 ? 1 : 0;
      most_change = std::max(most_change, change);
      changed_plain += roundingOf(value, {}) > 0 ? 1 : 0;
      if ((first + i) % step == 0) samples.push_back(value);
    }
  }
  void include(const Census& other) {
    least = std::min(least, other.least);
    greatest = std::max(greatest, other.greatest);
    changed += other.changed;
    most_change = std::max(most_change, other.most_change);
    changed_plain += other.changed_plain;
    samples.insert(samples.end(), other.samples.begin(), other.samples.end());
  }
  bool isEmpty() const { return least > greatest; }
};

struct ChosenVoxels {
  VoxelType type = VoxelType::kFloat32;
  ValueTransform values;
};

// The integer type that holds all numbers less an offset, if one of at most 16 bits does.
template <typename In>
std::optional<ChosenVoxels> integersOf(const Census<In>& census) {
  if constexpr (std::is_integral_v<In>) {
    const auto fits = [&](auto tag) {
      using Out = typename decltype(tag)::Type;
      if constexpr (std::is_integral_v<Out>)
        return std::in_range<Out>(census.least) && std::in_range<Out>(census.greatest);
      return false;
    };
    for (const VoxelType type :
         {VoxelType::kUint8, VoxelType::kInt8, VoxelType::kInt16, VoxelType::kUint16})
      if (visitVoxelType(type, fits)) return ChosenVoxels{type, {}};
    // A double that is not above the least number.
    auto offset = static_cast<double>(census.least);
    if (static_cast<Exact<In>>(offset) > static_cast<Exact<In>>(census.least))
      offset = std::nextafter(offset, -std::numeric_limits<double>::infinity());
    const Exact<In> most = storedOf(census.greatest, {1, offset});
    if (most <= 255) return ChosenVoxels{VoxelType::kUint8, {1, offset}};
    if (most <= 65535) return ChosenVoxels{VoxelType::kUint16, {1, offset}};
  }
  return std::nullopt;
}

// A scale that keeps numbers away from the denormals of float32; a power of two.
double scaleOf(double least, double greatest) {
  const double most = std::max(std::abs(least), std::abs(greatest));
  constexpr int kLeastExponent = -90;
  return most > 0 && std::ilogb(most) < kLeastExponent ? std::ldexp(1.0, std::ilogb(most)) : 1.0;
}

// Finds the transform whose rounding hurts samples the least. What counts is how it compares with
// the distance to the nearest other number, so a filling far away weighs no more than any other
// number.
template <typename In>
class TransformChoice {
 public:
  TransformChoice(std::vector<In> samples, In least, In greatest)
      : samples_(std::move(samples)),
        scale_(scaleOf(static_cast<double>(least), static_cast<double>(greatest))) {
    samples_.insert(samples_.end(), {least, greatest});
    std::ranges::sort(samples_);
    gaps_.assign(samples_.size(), std::numeric_limits<double>::infinity());
    // From the one before that differs; and back, from the one behind.
    const auto narrow = [&](std::size_t at, std::size_t last, std::size_t& other) {
      if (samples_[at] != samples_[last]) other = last;
      if (samples_[at] != samples_[other])
        gaps_[at] = std::min(
            gaps_[at], static_cast<double>(std::abs(static_cast<Exact<In>>(samples_[at]) -
                                                    static_cast<Exact<In>>(samples_[other]))));
    };
    for (std::size_t i = 1, other = 0; i < samples_.size(); ++i) narrow(i, i - 1, other);
    for (std::size_t i = samples_.size() - 1, other = i; i-- > 0;) narrow(i, i + 1, other);
  }

  double costOf(const ValueTransform& values) const {
    constexpr double kFine = 1024;  // a rounding so much less than the distance costs nothing
    double sum = 0;
    for (std::size_t i = 0; i < samples_.size(); ++i)
      sum += std::log2(1 + kFine * roundingOf(samples_[i], values) / gaps_[i]);
    return sum / static_cast<double>(samples_.size());
  }

  // A plain offset rather than one that is hardly better.
  ValueTransform best() const {
    std::vector<double> offsets{0};
    constexpr std::size_t kParts = 16;
    for (std::size_t i = 0; i <= kParts; ++i) {
      const auto value = static_cast<double>(samples_[(samples_.size() - 1) * i / kParts]);
      offsets.insert(offsets.end(), {std::round(value), value});
    }
    offsets.push_back(offsets[1] / 2 + offsets.back() / 2);
    ValueTransform best{scale_, 0};
    double best_cost = std::numeric_limits<double>::infinity();
    for (const double offset : offsets) {
      const double cost = costOf({scale_, offset});
      if (cost >= best_cost - kHardly) continue;
      best.offset = offset;
      best_cost = cost;
    }
    return best;
  }
  bool isAsGood(const ValueTransform& values, const ValueTransform& best) const {
    return values.scale == best.scale && costOf(values) <= costOf(best) + 2 * kHardly;
  }

 private:
  static constexpr double kHardly = 0.25;

  std::vector<In> samples_;   // ascending
  std::vector<double> gaps_;  // from each to the nearest other one
  double scale_;
};

template <typename In, typename Out>
void convertNumbers(const In* in, std::size_t count, const ValueTransform& values, Out* out) {
  for (std::size_t i = 0; i < count; ++i) out[i] = static_cast<Out>(storedOf(in[i], values));
}

class FittedSource final : public VolumeSource {
 public:
  FittedSource(std::unique_ptr<VolumeSource> numbers,
               std::function<std::unique_ptr<VolumeSource>()> open)
      : numbers_(std::move(numbers)), open_(std::move(open)), info_(numbers_->info()) {
    info_.numbers = info_.voxel_type;
    info_.voxel_type = VoxelType::kFloat32;
  }

  const VolumeInfo& info() const override { return info_; }
  bool readsBoxes() const override { return numbers_->readsBoxes(); }
  std::vector<std::string> files() const override { return numbers_->files(); }
  std::string identity() const override { return numbers_->identity(); }
  std::vector<std::string> notesOfReading() const override { return numbers_->notesOfReading(); }
  std::uint64_t bufferBytes() const override { return numbers_->bufferBytes() + kBytesAtATime; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    auto* to = static_cast<std::byte*>(out);
    forEachBlock(*numbers_, first, count,
                 [&](std::int64_t, std::int64_t rows, const std::byte* block) {
                   const auto voxels = static_cast<std::size_t>(rows * info_.voxels.x);
                   convert(block, voxels, to);
                   to += voxels * voxelBytes(info_.voxel_type);
                 });
  }

  void readBox(const IndexBox& box, void* out) const override {
    const std::size_t number_bytes = voxelBytes(*info_.numbers);
    const auto most = static_cast<std::int64_t>(kBytesAtATime / number_bytes);
    // As many slices as fit, or rows of one.
    const std::int64_t slices =
        std::clamp<std::int64_t>(most / (box.count.x * box.count.y), 1, box.count.z);
    const std::int64_t rows =
        slices > 1 ? box.count.y : std::clamp<std::int64_t>(most / box.count.x, 1, box.count.y);
    std::vector<std::byte> block(static_cast<std::size_t>(box.count.x * rows * slices) *
                                 number_bytes);
    auto* to = static_cast<std::byte*>(out);
    for (std::int64_t z = 0; z < box.count.z; z += slices)
      for (std::int64_t y = 0; y < box.count.y; y += rows) {
        const IndexBox part{
            box.first + Index3(0, y, z),
            {box.count.x, std::min(rows, box.count.y - y), std::min(slices, box.count.z - z)}};
        numbers_->readBox(part, block.data());
        const auto voxels = static_cast<std::size_t>(part.size());
        convert(block.data(), voxels, to);
        to += voxels * voxelBytes(info_.voxel_type);
      }
  }

  void chooseVoxels(const CancelFlag* cancel,
                    const std::function<void(double)>& progress) override {
    if (std::exchange(is_chosen_, true)) return;
    visitNumberType(*info_.numbers,
                    [&](auto tag) { choose<typename decltype(tag)::Type>(cancel, progress); });
    if (!readsBoxes()) numbers_ = open_();
  }

  void chooseVoxelsAs(const VolumeInfo& chosen) override {
    is_chosen_ = true;
    info_.voxel_type = chosen.voxel_type;
    info_.values = chosen.values;
    info_.range = chosen.range;
    for (const std::string& note : chosen.notes)
      if (note.starts_with(beginOfNote())) info_.notes.push_back(note);
  }

 private:
  // Calls take(first row, rows, bytes) with rows of `source` in blocks.
  template <typename Take>
  static void forEachBlock(VolumeSource& source, std::int64_t first, std::int64_t count,
                           Take&& take) {
    const std::size_t row_bytes =
        static_cast<std::size_t>(source.info().voxels.x) * voxelBytes(source.info().voxel_type);
    const std::int64_t most =
        std::clamp<std::int64_t>(static_cast<std::int64_t>(kBytesAtATime / row_bytes), 1, count);
    std::vector<std::byte> block(static_cast<std::size_t>(most) * row_bytes);
    for (const std::int64_t end = first + count; first < end;) {
      const std::int64_t rows = std::min(most, end - first);
      source.readRows(first, rows, block.data());
      take(first, rows, block.data());
      first += rows;
    }
  }

  void convert(const std::byte* from, std::size_t count, void* to) const {
    visitNumberType(*info_.numbers, [&](auto in_tag) {
      visitVoxelType(info_.voxel_type, [&](auto out_tag) {
        using In = typename decltype(in_tag)::Type;
        using Out = typename decltype(out_tag)::Type;
        convertNumbers(reinterpret_cast<const In*>(from), count, info_.values,
                       static_cast<Out*>(to));
      });
    });
  }

  // All numbers once, with a first guess of the transform; and once more if it was a bad one.
  template <typename In>
  void choose(const CancelFlag* cancel, const std::function<void(double)>& progress) {
    std::optional<ValueTransform> tried;
    Census<In> census = countAll<In>(tried, cancel, progress);
    if (census.isEmpty()) return;
    info_.range = {static_cast<double>(census.least), static_cast<double>(census.greatest)};
    ChosenVoxels chosen;
    if (const auto integers = integersOf(census)) {
      chosen = *integers;
      census.changed = 0;
    } else if (census.changed_plain == 0) {
      census.changed = 0;
    } else {
      const TransformChoice<In> choice(census.samples, census.least, census.greatest);
      const ValueTransform best = choice.best();
      const bool is_good = choice.isAsGood(*tried, best);
      chosen.values = is_good ? *tried : best;
      if (!is_good) {
        tried = best;
        if (!readsBoxes()) numbers_ = open_();
        census = countAll<In>(tried, cancel, progress);
      }
    }
    info_.voxel_type = chosen.type;
    info_.values = chosen.values;
    note(census.changed, census.most_change);
  }

  template <typename In>
  Census<In> countAll(std::optional<ValueTransform>& tried, const CancelFlag* cancel,
                      const std::function<void(double)>& progress) {
    const Index3& voxels = info_.voxels;
    const std::int64_t step =
        elementCount(voxels) / kMostScannedVoxels | 1;  // odd: no pattern of rows
    std::mutex mutex;
    const auto caller = std::this_thread::get_id();
    Census<In> all;
    std::int64_t done = 0;
    const auto count = [&](std::int64_t first_row, std::int64_t rows, const std::byte* block) {
      if (cancel != nullptr) cancel->check();
      const In* const numbers = reinterpret_cast<const In*>(block);
      if (!tried) tried = guess(numbers, rows * voxels.x);
      Census<In> some;
      some.add(numbers, rows * voxels.x, first_row * voxels.x, step, *tried);
      const std::lock_guard lock(mutex);
      all.include(some);
      done += rows;
      if (progress && std::this_thread::get_id() == caller)
        progress(static_cast<double>(done) / static_cast<double>(voxels.y * voxels.z));
    };
    if (!readsBoxes()) {
      forEachBlock(*numbers_, 0, voxels.y * voxels.z, count);
      return all;
    }
    std::vector<std::byte> slice(static_cast<std::size_t>(voxels.x * voxels.y) * sizeof(In));
    if (!tried) {  // in the middle, for any number of threads
      numbers_->readBox({{0, 0, voxels.z / 2}, {voxels.x, voxels.y, 1}}, slice.data());
      tried = guess(reinterpret_cast<const In*>(slice.data()), voxels.x * voxels.y);
    }
    const std::int64_t slices = std::clamp<std::int64_t>(
        static_cast<std::int64_t>(kBytesAtATime / slice.size()), 1, voxels.z);
    isolatedFor(std::int64_t{0}, (voxels.z + slices - 1) / slices, [&](std::int64_t slab) {
      const std::int64_t z = slab * slices, count_z = std::min(slices, voxels.z - z);
      std::vector<std::byte> block(slice.size() * static_cast<std::size_t>(count_z));
      numbers_->readBox({{0, 0, z}, {voxels.x, voxels.y, count_z}}, block.data());
      count(z * voxels.y, count_z * voxels.y, block.data());
    });
    return all;
  }

  template <typename In>
  static ValueTransform guess(const In* numbers, std::int64_t count) {
    Census<In> some;
    some.add(numbers, count, 0, count / 4096 | 1, {});
    if (some.isEmpty()) return {};
    return TransformChoice<In>(some.samples, some.least, some.greatest).best();
  }

  std::string beginOfNote() const {
    return std::string(voxelTypeName(*info_.numbers)) + " voxels became ";
  }
  void note(std::uint64_t changed, double most_change) {
    std::string text = beginOfNote() + std::string(voxelTypeName(info_.voxel_type));
    if (info_.values.offset != 0) text += " around " + numberText(info_.values.offset);
    if (info_.values.scale != 1) text += " in steps of " + numberText(info_.values.scale);
    const double range = info_.range.max - info_.range.min;
    text += changed == 0 ? "; no value changed"
                         : "; " + std::to_string(changed) + " of " +
                               std::to_string(elementCount(info_.voxels)) +
                               " values changed, by at most " + shortText(most_change) + " (" +
                               shortText(most_change / range) + " of their range)";
    info_.notes.push_back(text);
  }

  std::unique_ptr<VolumeSource> numbers_;
  const std::function<std::unique_ptr<VolumeSource>()> open_;
  VolumeInfo info_;
  bool is_chosen_ = false;
};

}  // namespace

std::unique_ptr<VolumeSource> withVoxels(std::unique_ptr<VolumeSource> numbers,
                                         std::function<std::unique_ptr<VolumeSource>()> open) {
  if (isStorable(numbers->info().voxel_type)) return numbers;
  return std::make_unique<FittedSource>(std::move(numbers), std::move(open));
}

}  // namespace isobrick
