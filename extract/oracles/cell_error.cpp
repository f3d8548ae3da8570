#include "isobrick/extract/oracles/cell_error.h"

#include <algorithm>
#include <array>
#include <vector>

#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

constexpr std::size_t numberOf(const Index3& at) {
  return static_cast<std::size_t>(at.x + 3 * at.y + 9 * at.z);
}

// The edges of level 0 in and around a closed cell of 1 or 2 steps along each axis.
struct CellEdges {
  struct Within {
    std::uint8_t from, to;  // numbers of voxels
  };
  struct Away {
    std::uint8_t from;
    Index3 to;  // counted from the cell's lowest voxel; outside of the cell
    int axis;
  };
  std::vector<Within> within;
  std::vector<Away> away;  // from points that are no corners

  explicit CellEdges(const Index3& steps) {
    const auto isEnd = [&](int axis, std::int64_t at) { return at == 0 || at == steps[axis]; };
    forEachIndex({Index3(0), steps + Index3(1)}, [&](const Index3& voxel) {
      const bool is_corner = isEnd(0, voxel.x) && isEnd(1, voxel.y) && isEnd(2, voxel.z);
      for (int axis = 0; axis < 3; ++axis)
        for (const std::int64_t step : {-1, 1}) {
          Index3 next = voxel;
          next[axis] += step;
          const bool is_within = next[axis] >= 0 && next[axis] <= steps[axis];
          const auto from = static_cast<std::uint8_t>(numberOf(voxel));
          if (is_within && step > 0)
            within.push_back({from, static_cast<std::uint8_t>(numberOf(next))});
          if (!is_within && !is_corner) away.push_back({from, next, axis});
        }
    });
  }
};

const CellEdges& edgesOf(const Index3& steps) {
  static const auto edges = [] {
    std::vector<CellEdges> all;
    forEachIndex({Index3(0), Index3(2)},
                 [&](const Index3& at) { all.emplace_back(at + Index3(1)); });
    return all;
  }();
  return edges[static_cast<std::size_t>(linearIndex(steps - Index3(1), Index3(2)))];
}

// The ends of edges as two rows.
class EdgeRows {
 public:
  void add(float value, float low, float high, float to_value, float to_low, float to_high) {
    const float ends[6] = {value, low, high, to_value, to_low, to_high};
    for (std::size_t i = 0; i < 6; ++i) rows_[i][count_] = ends[i];
    ++count_;
  }
  bool isAnyBeyond(const ErrorBound& bound) const {
    return hasCoarseEdge(row(0), row(3), static_cast<std::int64_t>(count_), bound);
  }

 private:
  static constexpr std::size_t kMostEdges = 54;  // in a cell of 2 x 2 x 2 steps
  BoundedRow row(std::size_t i) const {
    return {rows_[i].data(), rows_[i + 1].data(), rows_[i + 2].data()};
  }
  // What lies behind the last edge is read, and not looked at.
  std::array<std::array<float, kMostEdges + kErrorLanes>, 6> rows_{};
  std::size_t count_ = 0;
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
  bool is_any_inside = false, is_any_outside = false;
  for (std::int64_t z = 0; z <= steps_.z; ++z)
    for (std::int64_t y = 0; y <= steps_.y; ++y)
      for (std::int64_t x = 0; x <= steps_.x; ++x) {
        const bool is_inside = field_.value[numberOf({x, y, z})] >= bound_.isovalue;
        is_any_inside = is_any_inside || is_inside;
        is_any_outside = is_any_outside || !is_inside;
      }
  return is_any_inside && is_any_outside;
}

// From the corners to all voxels of the closed cell, axis by axis.
template <typename T>
void CellError<T>::interpolate(const float (&corners)[8], float (&field)[27]) const {
  const auto fill = [](float low, float high, std::int64_t steps, float* out, std::size_t stride) {
    out[0] = low;
    if (steps == 2) out[stride] = 0.5f * (low + high);
    out[static_cast<std::size_t>(steps) * stride] = high;
  };
  const auto x_count = static_cast<std::size_t>(steps_.x + 1);
  const auto y_step = static_cast<std::size_t>(3 * steps_.y);
  const auto z_step = static_cast<std::size_t>(9 * steps_.z);
  for (std::size_t row = 0; row < 4; ++row)
    fill(corners[2 * row], corners[2 * row + 1], steps_.x,
         field + (row & 1) * y_step + (row >> 1) * z_step, 1);
  for (std::size_t z = 0; z < 2; ++z)
    for (std::size_t x = 0; x < x_count; ++x) {
      float* const at = field + z * z_step + x;
      fill(at[0], at[y_step], steps_.y, at, 3);
    }
  for (std::size_t y = 0; y <= static_cast<std::size_t>(steps_.y); ++y)
    for (std::size_t x = 0; x < x_count; ++x) {
      float* const at = field + 3 * y + x;
      fill(at[0], at[z_step], steps_.z, at, 9);
    }
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
    std::copy_n(field_.low, 27, field_.high);
  else
    interpolate(high, field_.high);
}

template <typename T>
bool CellError<T>::isBeyondWithin(unsigned fine_corners) {
  bound(fine_corners);
  for (std::int64_t z = 0; z <= steps_.z; ++z)
    for (std::int64_t y = 0; y <= steps_.y; ++y)
      for (std::int64_t x = 0; x <= steps_.x; ++x) {
        const std::size_t i = numberOf({x, y, z});
        const float above = field_.value[i] - bound_.isovalue;
        const bool is_wrong =
            above >= 0 ? field_.low[i] < bound_.isovalue : field_.high[i] >= bound_.isovalue;
        if (is_wrong && std::abs(above) > bound_.tolerance) return true;
      }
  EdgeRows edges;
  for (const auto& [a, b] : edgesOf(steps_).within)
    edges.add(field_.value[a], field_.low[a], field_.high[a], field_.value[b], field_.low[b],
              field_.high[b]);
  return edges.isAnyBeyond(bound_);
}

template <typename T>
bool CellError<T>::isBeyondAround(unsigned fine_corners) {
  bound(fine_corners);
  EdgeRows edges;
  for (const auto& [a, to, axis] : edgesOf(steps_).away) {
    const Index3 at = lower_ + to;
    if (at[axis] < 0 || at[axis] >= lattice_.voxels()[axis]) continue;
    const float b = voxel(at);
    edges.add(field_.value[a], field_.low[a], field_.high[a], b, b, b);
  }
  return edges.isAnyBeyond(bound_);
}

#define ISOBRICK_INSTANTIATE(T) template class CellError<T>;
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
