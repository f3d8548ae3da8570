#include "isobrick/preprocess/derived_volume.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <string>
#include <utility>

#include "isobrick/preprocess/export/source_view.h"
#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/kernels/smoothing.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

// Three slices of the smoothed field, of which the one in the middle is compared with the source.
struct ShiftSlices {
  Index3 voxels;
  const float *below, *middle, *above;  // below and above may be the middle itself, at an end
  double step_z;                        // slices between them; 0: there is one alone
  glm::dmat3 to_world;                  // from a gradient per voxel to one per least spacing
  double nearby;                        // distance of what is not gone, in least spacings
};

// Adds the crossings of the edges that begin in row y of the slice. `next` is the source's slice
// above, or null.
template <typename T>
void addShifts(const ShiftSlices& slices, const T* slice, const T* next, std::int64_t y,
               float isovalue, SurfaceShift& shift) {
  const Index3& n = slices.voxels;
  const auto isInside = [&](T value) { return static_cast<float>(value) >= isovalue; };
  const auto difference = [](const float* field, std::int64_t low, std::int64_t high) {
    return high == low ? 0.0 : (static_cast<double>(field[high]) - static_cast<double>(field[low]));
  };
  for (std::int64_t x = 0; x < n.x; ++x) {
    const std::int64_t at = y * n.x + x;
    const std::array<const T*, 3> ends = {x + 1 < n.x ? slice + at + 1 : nullptr,
                                          y + 1 < n.y ? slice + at + n.x : nullptr,
                                          next != nullptr ? next + at : nullptr};
    const std::array<float, 3> smoothed = {x + 1 < n.x ? slices.middle[at + 1] : 0.0f,
                                           y + 1 < n.y ? slices.middle[at + n.x] : 0.0f,
                                           slices.above[at]};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (ends[axis] == nullptr || isInside(slice[at]) == isInside(*ends[axis])) continue;
      const auto low = static_cast<double>(slice[at]), high = static_cast<double>(*ends[axis]);
      const double t = (static_cast<double>(isovalue) - low) / (high - low);
      const double value = static_cast<double>(slices.middle[at]) * (1 - t) +
                           static_cast<double>(smoothed[axis]) * t;
      const std::int64_t left = x > 0 ? 1 : 0, right = x + 1 < n.x ? 1 : 0;
      const std::int64_t front = y > 0 ? 1 : 0, back = y + 1 < n.y ? 1 : 0;
      const glm::dvec3 gradient = {
          difference(slices.middle, at - left, at + right) / static_cast<double>(left + right),
          difference(slices.middle, at - front * n.x, at + back * n.x) /
              static_cast<double>(front + back),
          slices.step_z > 0
              ? (static_cast<double>(slices.above[at]) - static_cast<double>(slices.below[at])) /
                    slices.step_z
              : 0};
      const double distance =
          std::abs(value - static_cast<double>(isovalue)) / glm::length(slices.to_world * gradient);
      if (!(distance <= slices.nearby)) {
        ++shift.gone;
        continue;
      }
      ++shift.crossings;
      shift.sum += distance;
      shift.most = std::max(shift.most, distance);
    }
  }
}

// Reads slices of the source into a ring, smooths a slice along z as a whole, and its rows along y
// and x as they are asked for (kernels/smoothing.h). Each voxel is computed from its neighbours in
// a fixed order, so it is the same for any rows that are asked for at a time, and any number of
// threads. Works on the calling TBB arena. `shifts` may be null.
class SmoothedSource final : public SourceView {
 public:
  SmoothedSource(std::unique_ptr<VolumeSource> source, double sigma,
                 std::shared_ptr<std::vector<SurfaceShift>> shifts)
      : SourceView(std::move(source), "denoise " + numberText(sigma)),
        weights_(smoothingWeights(sigma)),
        reach_(static_cast<std::int64_t>(weights_.size())),
        nearby_(std::max(1.0, 2 * sigma)),
        shifts_(std::move(shifts)) {
    takeVoxels(source_->info());
    info_.properties.clear();  // they are about the values as they were
    if (shifts_ != nullptr)
      for (SurfaceShift& shift : *shifts_) shift = {.isovalue = shift.isovalue};
  }

  bool readsBoxes() const override { return false; }
  std::uint64_t bufferBytes() const override {
    const std::uint64_t slices_of_floats = 1 + (shifts_ != nullptr ? kWatched : 0);
    return source_->bufferBytes() + static_cast<std::uint64_t>(ringSlices()) * sliceBytes() +
           slices_of_floats * sliceVoxels() * sizeof(float);
  }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const std::int64_t width = info_.voxels.x;
    forEachSliceOfRows(info_, first, count, out,
                       [&](std::int64_t z, std::int64_t y, std::int64_t rows, std::byte* bytes) {
                         auto* const to = reinterpret_cast<float*>(bytes);
                         smoothSlice(z);
                         isolatedFor(std::int64_t{0}, rows,
                                     [&](std::int64_t i) { smoothRowAt(y + i, to + i * width); });
                         if (shifts_ != nullptr) watch(z, y, rows, to);
                       });
  }

 private:
  // A pyramid's brick, say, is unpacked once for so many slices.
  static constexpr std::int64_t kSlicesAtATime = 8;
  static constexpr std::int64_t kWatched = 3;

  void takeVoxels(const VolumeInfo& chosen) override {
    info_.voxel_type = VoxelType::kFloat32;
    info_.values = chosen.values;
    info_.range = chosen.range;
    info_.bounds.reset();
    double gain = 1;  // at most, along an axis, at a border too
    for (const float weight : weights_) gain += 4 * static_cast<double>(std::abs(weight));
    visitVoxelType(chosen.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      if constexpr (std::is_integral_v<T>) {
        const auto least = static_cast<double>(std::numeric_limits<T>::lowest());
        const auto most = static_cast<double>(std::numeric_limits<T>::max());
        const double middle = (least + most) / 2, half = (most - least) / 2 * gain * gain * gain;
        info_.bounds = {static_cast<float>(middle - half), static_cast<float>(middle + half)};
      }
    });
  }

  std::size_t sliceVoxels() const {
    return static_cast<std::size_t>(info_.voxels.x * info_.voxels.y);
  }
  std::size_t sliceBytes() const { return sliceVoxels() * voxelBytes(source_->info().voxel_type); }
  std::int64_t ringSlices() const { return 2 * reach_ + kSlicesAtATime; }
  template <typename T>
  const T* ringSlice(std::int64_t z) const {
    return reinterpret_cast<const T*>(ring_.data() +
                                      static_cast<std::size_t>(z % ringSlices()) * sliceBytes());
  }

  // Reads all slices up to `last`, and more if they fit in beside those from `first` on.
  void readSlices(std::int64_t first, std::int64_t last) {
    ring_.resize(static_cast<std::size_t>(ringSlices()) * sliceBytes());
    read_ = std::max(read_, first);
    while (read_ <= last) {
      const std::int64_t place = read_ % ringSlices();
      const std::int64_t slices =
          std::min({first + ringSlices(), info_.voxels.z, read_ + ringSlices() - place}) - read_;
      source_->readRows(read_ * info_.voxels.y, slices * info_.voxels.y,
                        ring_.data() + static_cast<std::size_t>(place) * sliceBytes());
      read_ += slices;
    }
  }

  void smoothSlice(std::int64_t z) {
    if (smoothed_z_ == z) return;
    const std::int64_t last = info_.voxels.z - 1;
    readSlices(std::max(z - reach_, std::int64_t{0}), std::min(z + reach_, last));
    along_z_.resize(sliceVoxels());
    const std::int64_t pairs = std::min({reach_, z, last - z});
    visitVoxelType(source_->info().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      isolatedFor(std::int64_t{0}, info_.voxels.y, [&](std::int64_t y) {
        smoothRowAcross<T>([&](std::int64_t k) { return ringSlice<T>(z + k) + y * info_.voxels.x; },
                           pairs, along_z_.data() + y * info_.voxels.x);
      });
    });
    smoothed_z_ = z;
  }

  void smoothRowAt(std::int64_t y, float* out) const {
    thread_local std::vector<float> row;
    row.resize(static_cast<std::size_t>(info_.voxels.x));
    const std::int64_t pairs = std::min({reach_, y, info_.voxels.y - 1 - y});
    smoothRowAcross<float>(
        [&](std::int64_t k) { return along_z_.data() + (y + k) * info_.voxels.x; }, pairs,
        row.data());
    smoothRow(row.data(), weights_, row.size(), out);
  }

  // rowAt(k): the row k steps further along the axis.
  template <typename T, typename RowAt>
  void smoothRowAcross(const RowAt& rowAt, std::int64_t pairs, float* out) const {
    thread_local std::vector<const T*> rows;
    rows.clear();
    for (std::int64_t k = 1; k <= pairs; ++k) {
      rows.push_back(rowAt(-k));
      rows.push_back(rowAt(k));
    }
    smoothAcross<T>(rowAt(0), rows, weights_.data(), static_cast<std::size_t>(info_.voxels.x), out);
  }

  // Takes note of rows of the smoothed slice z, and compares the slice before it with the source as
  // soon as it is whole.
  void watch(std::int64_t z, std::int64_t y, std::int64_t rows, const float* smoothed) {
    const Index3& n = info_.voxels;
    const std::int64_t first = z * n.y + y;
    if (first != watched_rows_) first_watched_ = z + (y > 0 ? 1 : 0);
    watched_rows_ = first + rows;
    auto& slice = watched_[static_cast<std::size_t>(z % kWatched)];
    slice.resize(sliceVoxels());
    std::copy_n(smoothed, rows * n.x, slice.begin() + y * n.x);
    if (y + rows < n.y) return;
    if (z > first_watched_) compare(z - 1, z);
    if (z == n.z - 1 && z >= first_watched_) compare(z, z);
  }

  // Slice z; `last`: the last one that there is.
  void compare(std::int64_t z, std::int64_t last) {
    const auto slice = [&](std::int64_t at) {
      return watched_[static_cast<std::size_t>(at % kWatched)].data();
    };
    const std::int64_t below = std::max(z - 1, first_watched_), above = std::min(z + 1, last);
    const double spacing = info_.geometry.leastSpacing();
    const ShiftSlices slices{
        info_.voxels,
        slice(below),
        slice(z),
        slice(above),
        static_cast<double>(above - below),
        glm::transpose(glm::inverse(info_.geometry.indexToWorldMatrix())) * spacing,
        nearby_};
    visitVoxelType(source_->info().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      for (SurfaceShift& shift : *shifts_) {
        const auto isovalue = static_cast<float>(info_.values.stored(shift.isovalue));
        std::vector<SurfaceShift> of_rows(static_cast<std::size_t>(info_.voxels.y));
        isolatedFor(std::int64_t{0}, info_.voxels.y, [&](std::int64_t y) {
          addShifts<T>(slices, ringSlice<T>(z), above > z ? ringSlice<T>(above) : nullptr, y,
                       isovalue, of_rows[static_cast<std::size_t>(y)]);
        });
        for (const SurfaceShift& row : of_rows) {  // in order: sums are the same for any threads
          shift.crossings += row.crossings;
          shift.gone += row.gone;
          shift.sum += row.sum;
          shift.most = std::max(shift.most, row.most);
        }
      }
    });
  }

  const std::vector<float> weights_;
  const std::int64_t reach_;     // of the kernel, in voxels
  const double nearby_;          // see SurfaceShift::gone
  std::vector<std::byte> ring_;  // of the source's slices: z lies at z % ringSlices()
  std::int64_t read_ = 0;        // the slice that is read next
  std::vector<float> along_z_;   // slice smoothed_z_, smoothed along z alone
  std::int64_t smoothed_z_ = -1;

  const std::shared_ptr<std::vector<SurfaceShift>> shifts_;
  std::array<std::vector<float>, kWatched> watched_;  // smoothed slices, z at z % kWatched
  std::int64_t watched_rows_ = -1;                    // the row behind the last of them
  std::int64_t first_watched_ = 0;                    // the first whole slice
};

}  // namespace

std::unique_ptr<VolumeSource> derivedVolume(std::unique_ptr<VolumeSource> source,
                                            const Derivation& derivation) {
  if (derivation.label) source = makeLabelSource(std::move(source), *derivation.label);
  if (derivation.denoise > 0)
    source =
        std::make_unique<SmoothedSource>(std::move(source), derivation.denoise, derivation.shifts);
  return source;
}

}  // namespace isobrick
