// The samples that a brick's leaves are made of: its own, and finer ones beside finer leaves.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <memory>
#include <optional>
#include <utility>

#include "isobrick/extract/meshing/leaf_rows.h"
#include "isobrick/extract/meshing/sample_view.h"
#include "isobrick/extract/oracles/residency_oracle.h"
#include "isobrick/extract/session/mesh_context.h"

namespace isobrick {

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
  // One of the held bricks whose closed boxes have the sample: the first with a leaf at it that the
  // surface may cross, else the first with a leaf, else the first.
  std::optional<Index3> brickWith(const Index3& fine) const {
    const Index3 bricks = context_.pyramid.layout().bricks(level_ - 1);
    const Index3 first = glm::max(fine - Index3(1), Index3(0)) / edge_;
    const Index3 last = glm::min(fine / edge_, bricks - Index3(1));
    std::optional<Index3> found;
    int best = -1;
    forEachIndex({first, last - first + Index3(1)}, [&](const Index3& brick) {
      if (best == 2 || !isHeld(brick)) return;
      const int worth = !hasLeafAt(brick, fine) ? 0
                        : context_.pyramid.brickRange(level_ - 1, brick).crosses(context_.isovalue)
                            ? 2
                            : 1;
      if (worth <= best) return;
      best = worth;
      found = brick;
    });
    return found;
  }
  // Whether a cell of this level that `fine` is a point of, and that lies in the finer brick, is
  // refined.
  bool hasLeafAt(const Index3& finer_brick, const Index3& fine) const {
    const std::int64_t half = edge_ / 2;
    const Index3 first = glm::max((fine - Index3(1)) / std::int64_t{2}, finer_brick * half);
    const Index3 last =
        glm::min(fine / std::int64_t{2}, (finer_brick + Index3(1)) * half - Index3(1));
    bool is_any = false;
    forEachIndex({first, last - first + Index3(1)},
                 [&](const Index3& cell) { is_any = is_any || leaves_.isRefined(cell); });
    return is_any;
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
