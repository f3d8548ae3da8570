// The samples that a brick's leaves are made of: its own, and finer ones beside finer leaves.
#pragma once

#include <array>
#include <limits>
#include <optional>
#include <utility>

#include "isobrick/extract/mesh_context.h"
#include "isobrick/extract/sample_view.h"

namespace isobrick {

// A brick of one level and the up to eight bricks of the next finer level in it. Each is asked for
// when its first sample is, and held as long as this object lives. T: the voxel type.
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
    if (!slot) hold(level_ - 1, 2L * brick_ + Index3(child & 1, child >> 1 & 1, child >> 2), slot);
    return slot->view;
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
};

}  // namespace isobrick
