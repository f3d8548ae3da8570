#include "tests/support/reference_pyramid.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <type_traits>

namespace isobrick::test {

namespace {

std::size_t sampleOffset(const Index3& dims, const Index3& index) {
  return static_cast<std::size_t>((index.z * dims.y + index.y) * dims.x + index.x);
}

// The samples of the finer level that make one sample of the coarser one, along one axis.
struct Taps {
  std::int64_t first = 0;
  int count = 1;  // 1: not filtered, 3: weights 1 2 1

  std::int64_t weight(int tap) const { return count == 3 && tap == 1 ? 2 : 1; }
};

Taps tapsOf(const Lattice& lattice, int fine_level, int axis, std::int64_t coarse_index,
            ReferenceFilter filter) {
  const std::int64_t last_sample = lattice.samples(fine_level)[axis] - 1;
  const std::int64_t last_voxel = lattice.voxels()[axis] - 1;
  const std::int64_t centre = 2 * coarse_index;
  if (centre > last_sample) return {last_sample, 1};
  if (filter == ReferenceFilter::kSubsample) return {centre, 1};
  const bool has_left = centre - 1 >= 0;
  const bool has_right = centre + 1 <= last_sample && ((centre + 1) << fine_level) <= last_voxel;
  if (has_left && has_right) return {centre - 1, 3};
  return {centre, 1};
}

// Sum is exact for integers (std::int64_t) and one fixed order of additions for floats (double).
template <typename Sum>
Sum weightedSum(const std::vector<float>& fine, const Index3& fine_dims, const Taps& tx,
                const Taps& ty, const Taps& tz) {
  Sum sum_z = 0;
  for (int k = 0; k < tz.count; ++k) {
    Sum sum_y = 0;
    for (int j = 0; j < ty.count; ++j) {
      Sum sum_x = 0;
      for (int i = 0; i < tx.count; ++i) {
        const float v = fine[sampleOffset(fine_dims, {tx.first + i, ty.first + j, tz.first + k})];
        sum_x += static_cast<Sum>(tx.weight(i)) * static_cast<Sum>(v);
      }
      sum_y += static_cast<Sum>(ty.weight(j)) * sum_x;
    }
    sum_z += static_cast<Sum>(tz.weight(k)) * sum_y;
  }
  return sum_z;
}

// FORMAT.md, section 4: beside NaN an axis is not filtered. Along z first, then y, then x.
double filteredBesideMissing(const std::vector<float>& fine, const Index3& fine_dims,
                             const std::array<Taps, 3>& taps, int axis, Index3 at) {
  if (axis == 3) return static_cast<double>(fine[sampleOffset(fine_dims, at)]);
  const Taps& own = taps[static_cast<std::size_t>(axis)];
  double sum = 0, middle = 0;
  for (int tap = 0; tap < own.count; ++tap) {
    at[axis] = own.first + tap;
    const double v = filteredBesideMissing(fine, fine_dims, taps, axis + 1, at);
    sum += static_cast<double>(own.weight(tap)) * v;
    if (own.count == 1 || tap == 1) middle = v;
  }
  if (own.count == 1) return middle;
  return std::isnan(sum) ? middle : sum / 4;
}

template <typename T>
float filteredSample(const std::vector<float>& fine, const Index3& fine_dims, const Taps& tx,
                     const Taps& ty, const Taps& tz) {
  const int filtered_axes = (tx.count == 3) + (ty.count == 3) + (tz.count == 3);
  const std::int64_t total_weight = std::int64_t{1} << (2 * filtered_axes);
  if constexpr (std::is_integral_v<T>) {
    const std::int64_t sum = weightedSum<std::int64_t>(fine, fine_dims, tx, ty, tz);
    // Right shift of a negative number is floor in C++20.
    return static_cast<float>((sum + total_weight / 2) >> (2 * filtered_axes));
  } else {
    const double sum = weightedSum<double>(fine, fine_dims, tx, ty, tz);
    if (std::isnan(sum))
      return static_cast<float>(filteredBesideMissing(fine, fine_dims, {tx, ty, tz}, 0, Index3(0)));
    return static_cast<float>(sum / static_cast<double>(total_weight));
  }
}

}  // namespace

bool isOnLattice(const Lattice& lattice, int level, int axis, std::int64_t position) {
  const std::int64_t step = std::int64_t{1} << level;
  return position % step == 0 || position == lattice.voxels()[axis] - 1;
}

bool isOnLattice(const Lattice& lattice, int level, const Index3& position) {
  return isOnLattice(lattice, level, 0, position.x) && isOnLattice(lattice, level, 1, position.y) &&
         isOnLattice(lattice, level, 2, position.z);
}

std::int64_t sampleIndex(const Lattice& lattice, int level, int axis, std::int64_t position) {
  if (position < 0 || position >= lattice.voxels()[axis] ||
      !isOnLattice(lattice, level, axis, position)) {
    throw std::logic_error("reference: a position that is not on the lattice of its level");
  }
  if (position == lattice.voxels()[axis] - 1) return lattice.samples(level)[axis] - 1;
  return position >> level;
}

Index3 sampleIndex(const Lattice& lattice, int level, const Index3& position) {
  return {sampleIndex(lattice, level, 0, position.x), sampleIndex(lattice, level, 1, position.y),
          sampleIndex(lattice, level, 2, position.z)};
}

float ReferencePyramid::sampleAt(int level, const Index3& sample) const {
  return levels.at(static_cast<std::size_t>(level))
      .at(sampleOffset(lattice.samples(level), sample));
}

float ReferencePyramid::sampleAtPosition(int level, const Index3& position) const {
  return sampleAt(level, sampleIndex(lattice, level, position));
}

template <typename T>
ReferencePyramid buildReferencePyramid(const Index3& dims, std::span<const T> voxels,
                                       ReferenceFilter filter) {
  if (dims.x < 2 || dims.y < 2 || dims.z < 2 ||
      voxels.size() != static_cast<std::size_t>(elementCount(dims))) {
    throw std::invalid_argument("reference pyramid: dimensions and voxels do not agree");
  }
  ReferencePyramid pyramid;
  pyramid.lattice = Lattice(dims);
  const Lattice& lattice = pyramid.lattice;
  pyramid.levels.emplace_back(voxels.begin(), voxels.end());

  for (int level = 1; level < lattice.levels(); ++level) {
    const std::vector<float>& fine = pyramid.levels.back();
    const Index3 fine_dims = lattice.samples(level - 1);
    const Index3 coarse_dims = lattice.samples(level);
    std::vector<float> coarse;
    for (std::int64_t z = 0; z < coarse_dims.z; ++z) {
      for (std::int64_t y = 0; y < coarse_dims.y; ++y) {
        for (std::int64_t x = 0; x < coarse_dims.x; ++x) {
          const Taps tx = tapsOf(lattice, level - 1, 0, x, filter);
          const Taps ty = tapsOf(lattice, level - 1, 1, y, filter);
          const Taps tz = tapsOf(lattice, level - 1, 2, z, filter);
          coarse.push_back(filteredSample<T>(fine, fine_dims, tx, ty, tz));
        }
      }
    }
    pyramid.levels.push_back(std::move(coarse));
  }
  return pyramid;
}

template ReferencePyramid buildReferencePyramid<std::uint8_t>(const Index3&,
                                                              std::span<const std::uint8_t>,
                                                              ReferenceFilter);
template ReferencePyramid buildReferencePyramid<std::int8_t>(const Index3&,
                                                             std::span<const std::int8_t>,
                                                             ReferenceFilter);
template ReferencePyramid buildReferencePyramid<std::uint16_t>(const Index3&,
                                                               std::span<const std::uint16_t>,
                                                               ReferenceFilter);
template ReferencePyramid buildReferencePyramid<std::int16_t>(const Index3&,
                                                              std::span<const std::int16_t>,
                                                              ReferenceFilter);
template ReferencePyramid buildReferencePyramid<float>(const Index3&, std::span<const float>,
                                                       ReferenceFilter);

}  // namespace isobrick::test
