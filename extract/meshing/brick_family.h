// The samples that a brick's leaves are made of: its own, and finer ones beside finer leaves.
#pragma once

#include <array>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "isobrick/extract/mesh_context.h"
#include "isobrick/extract/oracles/residency_oracle.h"
#include "isobrick/extract/sample_view.h"

namespace isobrick {

// A brick of one level and the up to eight bricks of the next finer level in it. Each is asked for
// when its first sample is, and held as long as this object lives. Where a query is one for now and
// one of the finer bricks is not resident, a brick beside it that has the sample in its closed box
// too takes its place: ResidencyOracle sees to it that there is one. T: the voxel type.
template <typename T>
class BrickFamily {
 public:
  BrickFamily(const MeshContext& context, int level, const Index3& brick)
      : context_(context), level_(level), brick_(brick) {
    if (level == 0) return;
    const BrickLayout& layout = context.pyramid.layout();
    const Index3 second = 2L * brick + Index3(1);
    for (int axis = 0; axis < 3; ++axis)
      middle_[axis] = second[axis] < layout.bricks(level - 1)[axis]
                          ? second[axis] * layout.brickCells()
                          : std::numeric_limits<std::int64_t>::max();
  }

  const SampleView<T>& own() {
    if (!own_) hold(level_, brick_, own_);
    return own_->view;
  }
  const BrickSamples& ownSamples() {
    if (!own_) hold(level_, brick_, own_);
    return own_->samples;
  }
  // The finer brick that holds sample `fine` of the finer level, a point of this brick.
  const SampleView<T>& finer(const Index3& fine) {
    const int child = (fine.x >= middle_.x ? 1 : 0) + (fine.y >= middle_.y ? 2 : 0) +
                      (fine.z >= middle_.z ? 4 : 0);
    auto& slot = finer_[static_cast<std::size_t>(child)];
    if (slot) return slot->view;
    const Index3 brick = 2L * brick_ + Index3(child & 1, child >> 1 & 1, child >> 2);
    if (!isHeld(brick))
      if (const auto other = heldBrickWith(fine)) {
        auto& beside = beside_[context_.pyramid.brickRow(level_ - 1, *other)];
        if (!beside) hold(level_ - 1, *other, beside);
        return beside->view;
      }
    hold(level_ - 1, brick, slot);
    return slot->view;
  }
  // Where finer() gives the same brick for all samples of the finer level from `fine` on along x.
  std::int64_t endOfFiner(const Index3& fine) const {
    if (context_.residency != nullptr) return fine.x + 1;
    return fine.x < middle_.x ? middle_.x : std::numeric_limits<std::int64_t>::max();
  }
  // False where finer() would have to read, of a query for now. Then the sample, and that of this
  // level in its place, lie in a brick that the surface does not cross, on the same side of it.
  bool hasFiner(const Index3& fine) const {
    return context_.residency == nullptr || heldBrickWith(fine).has_value();
  }
  // The brick that holds sample `sample` of `level`: this level or the next finer one.
  const SampleView<T>& at(int level, const Index3& sample) {
    return level == level_ ? own() : finer(sample);
  }

 private:
  struct HeldBrick {
    BrickSamples samples;
    SampleView<T> view;
  };
  bool isHeld(const Index3& finer_brick) const {
    return context_.residency == nullptr ||
           context_.residency->holdsSamples(level_ - 1, finer_brick);
  }
  // One of those whose closed boxes have the sample.
  std::optional<Index3> heldBrickWith(const Index3& fine) const {
    const BrickLayout& layout = context_.pyramid.layout();
    const Index3 first = glm::max(fine - Index3(1), Index3(0)) / layout.brickCells();
    const Index3 last = glm::min(fine / layout.brickCells(), layout.bricks(level_ - 1) - Index3(1));
    std::optional<Index3> found;
    forEachIndex({first, last - first + Index3(1)}, [&](const Index3& brick) {
      if (!found && isHeld(brick)) found = brick;
    });
    return found;
  }
  void hold(int level, const Index3& brick, std::optional<HeldBrick>& out) const {
    BrickSamples samples = context_.samples(level, brick);
    SampleView<T> view(context_.lattice(), level, samples.box, samples.template data<T>());
    out.emplace(std::move(samples), std::move(view));
  }

  const MeshContext& context_;
  const int level_;
  const Index3 brick_;
  Index3 middle_{0};  // first sample of the second of the finer bricks, where there are two
  std::optional<HeldBrick> own_;
  std::array<std::optional<HeldBrick>, 8> finer_;
  std::map<std::size_t, std::optional<HeldBrick>> beside_;  // by row of the brick table
};

}  // namespace isobrick
