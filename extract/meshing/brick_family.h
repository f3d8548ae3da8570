// The samples that a brick's leaves are made of: its own, and finer ones beside finer leaves.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

#include "isobrick/extract/kernels/edge_crossings.h"
#include "isobrick/extract/meshing/leaf_rows.h"
#include "isobrick/extract/oracles/residency_oracle.h"
#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// Reads samples of `level` by their index in the level. Borrowed memory: valid while the brick is
// held. T: the voxel type.
template <typename T>
class SampleView {
 public:
  SampleView(const Lattice& lattice, int level, const IndexBox& box, const T* data)
      : data_(data),
        box_(box),
        lattice_(&lattice),
        level_(level),
        stride_{1, box.count.x, box.count.x * box.count.y},
        inverse_(1.0f / static_cast<float>(std::int64_t{2} << level)) {
    for (int axis = 0; axis < 3; ++axis)
      regular_end_[axis] =
          std::min(box.count[axis] - 1, ((lattice.voxels()[axis] - 1) >> level) - box.first[axis]);
  }

  std::int64_t offset(const Index3& sample) const {
    return linearIndex(sample - box_.first, box_.count);
  }
  std::int64_t stride(int axis) const { return stride_[axis]; }
  const T* at(std::int64_t offset) const { return data_ + offset; }
  float value(const Index3& sample) const { return static_cast<float>(data_[offset(sample)]); }

  // Value and gradient to `out`: central differences, in values per voxel of level 0 (rule 12).
  void end(const Index3& sample, EdgeEnd& out) const {
    const Index3 local = sample - box_.first;
    const T* at = data_ + linearIndex(local, box_.count);
    out.value = static_cast<float>(*at);
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t i = local[axis], step = stride_[axis];
      (&out.gradient.x)[axis] =
          i > 0 && i < regular_end_[axis]
              ? (static_cast<float>(at[step]) - static_cast<float>(at[-step])) * inverse_
              : borderDifference(at, axis, i);
      if constexpr (std::is_floating_point_v<T>)
        if (std::isnan((&out.gradient.x)[axis]))
          (&out.gradient.x)[axis] = differenceBesideMissing(at, axis, i);
    }
  }
  // True if a neighbour of the sample, from which its gradient comes, has no data.
  bool isBesideMissing(const Index3& sample) const {
    const Index3 local = sample - box_.first;
    const T* at = data_ + linearIndex(local, box_.count);
    for (int axis = 0; axis < 3; ++axis)
      if ((local[axis] > 0 && isMissing(at[-stride_[axis]])) ||
          (local[axis] + 1 < box_.count[axis] && isMissing(at[stride_[axis]])))
        return true;
    return false;
  }
  static bool isMissing(T value) { return std::isnan(static_cast<float>(value)); }

 private:
  // One-sided, as at the border of the volume; 0 if neither neighbour has data.
  float differenceBesideMissing(const T* at, int axis, std::int64_t i) const {
    for (const std::int64_t step : {-1, 1}) {
      if (i + step < 0 || i + step >= box_.count[axis]) continue;
      const float change = static_cast<float>(at[step * stride_[axis]]) - static_cast<float>(*at);
      if (std::isnan(change)) continue;
      return change /
             static_cast<float>(lattice_->position(level_, axis, box_.first[axis] + i + step) -
                                lattice_->position(level_, axis, box_.first[axis] + i));
    }
    return 0;
  }
  // At the border of the volume the difference is one-sided, or over a thin cell. Elsewhere a
  // brick's own corners always have both neighbours in the apron; no gradient is taken in the apron
  // itself.
  float borderDifference(const T* at, int axis, std::int64_t i) const {
    const std::int64_t low = i > 0 ? i - 1 : i;
    const std::int64_t high = i + 1 < box_.count[axis] ? i + 1 : i;
    const auto distance =
        static_cast<float>(lattice_->position(level_, axis, box_.first[axis] + high) -
                           lattice_->position(level_, axis, box_.first[axis] + low));
    return (static_cast<float>(at[(high - i) * stride_[axis]]) -
            static_cast<float>(at[(low - i) * stride_[axis]])) /
           distance;
  }

  const T* data_;
  IndexBox box_;
  const Lattice* lattice_;
  int level_;
  std::int64_t stride_[3];
  // Samples 1 .. regular_end_ - 1 of the box have neighbours on both sides, 2^level voxels away.
  std::int64_t regular_end_[3];
  float inverse_;  // of the distance between these
};

// Of a finer brick for a sample at its border: whether it has a leaf there, and the surface may
// cross it.
enum class Worth { kNoLeaf, kLeaf, kCrossed };

// The brick of level `finer` that lends sample `fine` to coarser leaves: of those whose closed
// boxes have the sample, of which `may_lend(brick)`, and that are worth at least `least`, the first
// of the greatest worth. `is_refined(cell)`: of the next coarser level.
template <typename MayLend, typename IsRefined>
std::optional<Index3> lenderOf(const MeshContext& context, int finer, const Index3& fine,
                               Worth least, const MayLend& may_lend, const IsRefined& is_refined) {
  const BrickLayout& layout = context.pyramid.layout();
  const auto worthOf = [&](const Index3& brick) {
    const IndexBox own = layout.brickCellBox(finer, brick);
    const Index3 first = glm::max(fine - Index3(1), own.first) / std::int64_t{2};
    const Index3 last = glm::min(fine, own.end() - Index3(1)) / std::int64_t{2};
    bool has_leaf = false;
    forEachIndex({first, last - first + Index3(1)},
                 [&](const Index3& cell) { has_leaf = has_leaf || is_refined(cell); });
    if (!has_leaf) return Worth::kNoLeaf;
    return context.pyramid.brickRange(finer, brick).crosses(context.isovalue) ? Worth::kCrossed
                                                                              : Worth::kLeaf;
  };
  const Index3 first = glm::max(fine - Index3(1), Index3(0)) / layout.brickCells();
  const Index3 last = glm::min(fine / layout.brickCells(), layout.bricks(finer) - Index3(1));
  std::optional<Index3> found;
  Worth best = least;
  forEachIndex({first, last - first + Index3(1)}, [&](const Index3& brick) {
    if ((found && best == Worth::kCrossed) || !may_lend(brick)) return;
    const Worth worth = worthOf(brick);
    if (worth < best || (found && worth == best)) return;
    best = worth;
    found = brick;
  });
  return found;
}

// A brick of one level and the bricks of the next finer level in its closed box. Each is read when
// its first sample is needed, and held as long as this object lives. A sample on the border of
// finer bricks is taken from one that has a leaf there, which most likely is read anyway. If a
// query is progressive and that one is not resident, another that has the sample takes its place:
// ResidencyOracle ensures that there is one. T: the voxel type.
template <typename T>
class BrickFamily {
 public:
  // `leaves`: of the brick; samples of the finer level are taken only if the rows of cells around
  // them were found.
  BrickFamily(const MeshContext& context, const LeafRows& leaves, int level, const Index3& brick)
      : context_(context),
        leaves_(leaves),
        level_(level),
        brick_(brick),
        edge_(context.pyramid.layout().brickCells()),
        shift_(std::countr_zero(static_cast<std::uint64_t>(edge_))),
        tile_edge_(context.pyramid.layout().tileCells()),
        tile_shift_(std::countr_zero(static_cast<std::uint64_t>(tile_edge_))) {}

  const SampleView<T>& own() {
    if (!own_) hold(level_, brick_, own_);
    return own_->view;
  }
  const BrickSamples& ownSamples() {
    if (!own_) hold(level_, brick_, own_);
    return own_->samples;
  }
  // A finer brick that holds sample `fine` of the finer level, a point of this brick's closed box.
  const SampleView<T>& finer(const Index3& fine) {
    if (last_finer_ != nullptr && last_finer_->hasCorner(fine)) return last_finer_->view;
    FinerBrick& slot = slotWith(fine);
    if (!slot.held) hold(level_ - 1, slot.brick, slot.held);
    last_finer_ = &*slot.held;
    return slot.held->view;
  }
  // The end of the samples of the finer level from `fine` on along x that the brick of finer()
  // holds.
  std::int64_t endOfFiner(const Index3& fine) const {
    const std::int64_t past = fine.x & (edge_ - 1);
    return context_.residency != nullptr || past == 0 ? fine.x + 1 : fine.x - past + edge_;
  }
  // Up to where, from sample `fine` on along x, it is known without reading samples that those of
  // the finer level are on the same side of the isovalue as those of this level in their places: a
  // tile that the surface does not cross has both (rule 7), and so has a brick that a progressive
  // query does not need. `fine.x` if that is not known.
  std::int64_t endOfOwnSide(const Index3& fine) {
    if (context_.residency != nullptr) return brickWith(fine) ? fine.x : fine.x + 1;
    if (!context_.query.cull_by_ranges) return fine.x;
    FinerBrick& slot = slotWith(fine);
    if (slot.held) return fine.x;
    if (!slot.is_crossed)
      slot.is_crossed =
          context_.pyramid.brickRange(level_ - 1, slot.brick).crosses(context_.isovalue);
    const IndexBox& cells = slot.cells;
    if (!*slot.is_crossed) return cells.end().x + 1;
    if (!slot.ranges) slot.ranges = context_.ranges(level_ - 1, slot.brick);
    const auto tileOf = [&](int axis) {
      return std::min(fine[axis] - cells.first[axis], cells.count[axis] - 1) >> tile_shift_;
    };
    const std::int64_t number = tileOf(0) + slot.tiles.x * (tileOf(1) + slot.tiles.y * tileOf(2));
    if (slot.ranges->template tile<T>(static_cast<std::size_t>(number)).crosses(context_.isovalue))
      return fine.x;
    return cells.first.x + (tileOf(0) + 1) * tile_edge_ + 1;
  }
  // The brick that holds sample `sample` of `level`: this level or the next finer one.
  const SampleView<T>& at(int level, const Index3& sample) {
    return level == level_ ? own() : finer(sample);
  }

 private:
  struct HeldBrick {
    BrickSamples samples;
    SampleView<T> view;
    IndexBox corners;  // of its cells

    bool hasCorner(const Index3& sample) const {
      const auto isIn = [&](int axis) {
        return static_cast<std::uint64_t>(sample[axis] - corners.first[axis]) <
               static_cast<std::uint64_t>(corners.count[axis]);
      };
      return isIn(0) && isIn(1) && isIn(2);
    }
  };
  struct FinerBrick {
    Index3 brick{0};
    IndexBox cells;  // of its level
    Index3 tiles{0};
    std::optional<HeldBrick> held;
    std::optional<bool> is_crossed;  // by the surface, as far as is known without its ranges
    std::optional<BrickRanges> ranges;
  };
  FinerBrick& slotWith(const Index3& fine) {
    Index3 brick(fine.x >> shift_, fine.y >> shift_, fine.z >> shift_);
    if ((fine.x & (edge_ - 1)) == 0 || (fine.y & (edge_ - 1)) == 0 || (fine.z & (edge_ - 1)) == 0)
      brick = brickWith(fine).value_or(
          glm::min(brick, context_.pyramid.layout().bricks(level_ - 1) - Index3(1)));
    const Index3 place = brick - 2L * brick_ + Index3(1);
    auto& slot = finer_[static_cast<std::size_t>(linearIndex(place, Index3(4)))];
    if (!slot) {
      slot = std::make_unique<FinerBrick>();
      slot->brick = brick;
      slot->cells = context_.pyramid.layout().brickCellBox(level_ - 1, brick);
      slot->tiles = context_.pyramid.layout().brickTiles(level_ - 1, brick);
    }
    return *slot;
  }
  bool isHeld(const Index3& finer_brick) const {
    return context_.residency == nullptr ||
           context_.residency->holdsSamples(level_ - 1, finer_brick);
  }
  std::optional<Index3> brickWith(const Index3& fine) const {
    return lenderOf(
        context_, level_ - 1, fine, Worth::kNoLeaf,
        [this](const Index3& brick) { return isHeld(brick); },
        [this](const Index3& cell) { return leaves_.isRefined(cell); });
  }
  void hold(int level, const Index3& brick, std::optional<HeldBrick>& out) const {
    BrickSamples samples = context_.samples(level, brick);
    SampleView<T> view(context_.lattice(), level, samples.box, samples.template data<T>());
    IndexBox corners = context_.pyramid.layout().brickCellBox(level, brick);
    corners.count += Index3(1);
    out.emplace(HeldBrick{std::move(samples), std::move(view), corners});
  }

  const MeshContext& context_;
  const LeafRows& leaves_;
  const int level_;
  const Index3 brick_;
  const std::int64_t edge_;  // of a brick, in cells; a power of two
  const int shift_;          // its logarithm
  const std::int64_t tile_edge_;
  const int tile_shift_;
  std::optional<HeldBrick> own_;
  const HeldBrick* last_finer_ = nullptr;              // used last
  std::array<std::unique_ptr<FinerBrick>, 64> finer_;  // and those around, x fastest
};

}  // namespace isobrick
