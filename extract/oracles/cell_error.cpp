#include "isobrick/extract/oracles/cell_error.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

constexpr std::size_t numberOf(const Index3& at) {
  return static_cast<std::size_t>(at.x + 3 * at.y + 9 * at.z);
}

// The voxels and edges of level 0 in a closed cell of 1 or 2 steps along each axis, and the edges
// that lead away from it.
struct CellParts {
  std::uint32_t voxels = 0;
  std::uint32_t edges[3] = {};  // by axis, in the bits of their lower ends
  struct Away {
    std::size_t from;
    Index3 to;  // counted from the cell's lowest voxel; outside of the cell
    int axis;
  };
  std::vector<Away> away;  // from points that are no corners

  explicit CellParts(const Index3& steps) {
    const auto isEnd = [&](int axis, std::int64_t at) { return at == 0 || at == steps[axis]; };
    forEachIndex({Index3(0), steps + Index3(1)}, [&](const Index3& voxel) {
      const bool is_corner = isEnd(0, voxel.x) && isEnd(1, voxel.y) && isEnd(2, voxel.z);
      const std::size_t from = numberOf(voxel);
      voxels |= std::uint32_t{1} << from;
      for (int axis = 0; axis < 3; ++axis)
        for (const std::int64_t step : {-1, 1}) {
          Index3 next = voxel;
          next[axis] += step;
          const bool is_within = next[axis] >= 0 && next[axis] <= steps[axis];
          if (is_within && step > 0) edges[axis] |= std::uint32_t{1} << from;
          if (!is_within && !is_corner) away.push_back({from, next, axis});
        }
    });
  }
};
// Of an edge's ends along each axis.
constexpr std::ptrdiff_t kNext[3] = {1, 3, 9};

const CellParts& partsOf(const Index3& steps) {
  static const auto parts = [] {
    std::vector<CellParts> all;
    forEachIndex({Index3(0), Index3(2)},
                 [&](const Index3& at) { all.emplace_back(at + Index3(1)); });
    return all;
  }();
  return parts[static_cast<std::size_t>(linearIndex(steps - Index3(1), Index3(2)))];
}

// From the corners of a cell to all its voxels, axis by axis. What `steps` has may be known to the
// compiler.
template <typename Steps>
void spread(const float (&corners)[8], const Steps& steps, float* field) {
  const auto fill = [](float low, float high, std::int64_t count, float* out, std::size_t stride) {
    out[0] = low;
    if (count == 2) out[stride] = 0.5f * low + 0.5f * high;  // their sum may be infinite
    out[static_cast<std::size_t>(count) * stride] = high;
  };
  const auto x_count = static_cast<std::size_t>(steps.x + 1);
  const auto y_count = static_cast<std::size_t>(steps.y + 1);
  const std::size_t y_step = 3 * (y_count - 1);
  const auto z_step = static_cast<std::size_t>(9 * steps.z);
  for (std::size_t row = 0; row < 4; ++row)
    fill(corners[2 * row], corners[2 * row + 1], steps.x,
         field + (row & 1) * y_step + (row >> 1) * z_step, 1);
  for (std::size_t z = 0; z < 2; ++z)
    for (std::size_t x = 0; x < x_count; ++x) {
      float* const at = field + z * z_step + x;
      fill(at[0], at[y_step], steps.y, at, 3);
    }
  for (std::size_t y = 0; y < y_count; ++y)
    for (std::size_t x = 0; x < x_count; ++x) {
      float* const at = field + 3 * y + x;
      fill(at[0], at[z_step], steps.z, at, 9);
    }
}
struct WholeSteps {
  static constexpr std::int64_t x = 2, y = 2, z = 2;
};

}  // namespace

template <typename T>
void CellError<T>::load(const Index3& cell) {
  lower_ = lattice_.position(1, cell);
  steps_ = lattice_.position(1, cell + Index3(1)) - lower_;
  for (std::int64_t z = 0; z <= steps_.z; ++z)
    for (std::int64_t y = 0; y <= steps_.y; ++y) {
      const T* row = voxels_.data<T>() +
                     linearIndex(lower_ + Index3(0, y, z) - voxels_.box.first, voxels_.box.count);
      for (std::int64_t x = 0; x <= steps_.x; ++x)
        field_.value[numberOf({x, y, z})] = static_cast<float>(row[x]);
    }
  const T* sample = samples_.data<T>() + linearIndex(cell - samples_.box.first, samples_.box.count);
  for (unsigned c = 0; c < 8; ++c) {
    const Index3 corner(c & 1, c >> 1 & 1, c >> 2);
    fine_[c] = field_.value[numberOf(corner * steps_)];
    coarse_[c] = static_cast<float>(sample[linearIndex(corner, samples_.box.count)]);
  }
}

template <typename T>
bool CellError<T>::isCrossed() const {
  std::uint32_t inside = 0;
  for (std::size_t i = 0; i < kVoxels; ++i)
    inside |= static_cast<std::uint32_t>(field_.value[i] >= bound_.isovalue) << i;
  const std::uint32_t voxels = partsOf(steps_).voxels;
  return (inside & voxels) != 0 && (~inside & voxels) != 0;
}

template <typename T>
void CellError<T>::interpolate(const float (&corners)[8], Values& field) const {
  if (steps_ == Index3(2))
    spread(corners, WholeSteps(), field);
  else
    spread(corners, steps_, field);
}

template <typename T>
void CellError<T>::bound(unsigned fine_corners) {
  float low[8], high[8];
  for (unsigned c = 0; c < 8; ++c) {
    const bool is_fine = (fine_corners >> c & 1) != 0;
    low[c] = is_fine ? fine_[c] : std::min(fine_[c], coarse_[c]);
    high[c] = is_fine ? fine_[c] : std::max(fine_[c], coarse_[c]);
  }
  interpolate(low, field_.low);
  if (fine_corners == kAllCorners)
    std::copy_n(field_.low, kVoxels, field_.high);
  else
    interpolate(high, field_.high);
}

template <typename T>
bool CellError<T>::isBeyondWithin(unsigned fine_corners) {
  bound(fine_corners);
  const CellParts& parts = partsOf(steps_);
  std::uint32_t beyond = 0;
  for (std::size_t i = 0; i < kVoxels; ++i) {
    const float above = field_.value[i] - bound_.isovalue;
    const bool is_wrong =
        above >= 0 ? field_.low[i] < bound_.isovalue : field_.high[i] >= bound_.isovalue;
    beyond |= static_cast<std::uint32_t>(is_wrong & (std::abs(above) > bound_.tolerance)) << i;
  }
  if ((beyond & parts.voxels) != 0) return true;
  const auto rowFrom = [&](std::ptrdiff_t first) {
    return BoundedRow{field_.value + first, field_.low + first, field_.high + first};
  };
  for (int axis = 0; axis < 3; ++axis)
    if (hasCoarseEdge(rowFrom(0), rowFrom(kNext[axis]), parts.edges[axis], bound_)) return true;
  return false;
}

template <typename T>
bool CellError<T>::isBeyond(unsigned fine_corners) {
  return isBeyondWithin(fine_corners) || isBeyondAround();
}

template <typename T>
bool CellError<T>::isBeyondAround() const {
  Field from = {}, to = {};
  unsigned count = 0;
  for (const auto& [a, position, axis] : partsOf(steps_).away) {
    const Index3 at = lower_ + position;
    if (at[axis] < 0 || at[axis] >= lattice_.voxels()[axis]) continue;
    from.value[count] = field_.value[a];
    from.low[count] = field_.low[a];
    from.high[count] = field_.high[a];
    to.value[count] = to.low[count] = to.high[count] = voxel(at);
    ++count;
  }
  return hasCoarseEdge({from.value, from.low, from.high}, {to.value, to.low, to.high},
                       (std::uint32_t{1} << count) - 1, bound_);
}

#define ISOBRICK_INSTANTIATE(T) template class CellError<T>;
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
