#include "isobrick/extract/session/brick_traversal.h"

#include <algorithm>

#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

class Traversal {
 public:
  explicit Traversal(const MeshContext& context)
      : context_(context), layout_(context.pyramid.layout()), classifier_(context) {}

  std::vector<BrickWork> run() {
    const int top = context_.lattice().levels() - 1;
    if (context_.pyramid.parts().isRemote()) bringInRows(top);
    visit(top, Index3(0));  // the coarsest level is one cell
    const auto isFinest = [](const BrickWork& work) { return work.level == 0; };
    if (std::all_of(work_.begin(), work_.end(), isFinest))
      std::sort(work_.begin(), work_.end(), [&](const BrickWork& a, const BrickWork& b) {
        return context_.pyramid.parts().brickRow(0, a.brick) <
               context_.pyramid.parts().brickRow(0, b.brick);
      });
    return std::move(work_);
  }

  std::vector<BrickWork> runFinest(const IndexBox& bricks) {
    forEachIndex(bricks, [&](const Index3& brick) { visit(0, brick); });
    return std::move(work_);
  }

 private:
  // A server is asked for all rows of the brick table together that the traversal may come to: a
  // range that is not known yet prunes nothing. Then once more, if those were too many at once.
  void bringInRows(int top) {
    constexpr int kMostRounds = 64;  // a longer table has more rows than stay
    for (int round = 0; round < kMostRounds; ++round) {
      absent_rows_.clear();
      findAbsentRows(top, Index3(0));
      if (absent_rows_.empty()) return;
      context_.pyramid.parts().bringInRows(absent_rows_);
    }
  }

  void findAbsentRows(int level, const Index3& brick) {
    constexpr std::size_t kMostRows = std::size_t{1} << 15;
    if (absent_rows_.size() == kMostRows) return;
    context_.checkCancel();
    const IndexBox cells = layout_.brickCellBox(level, brick);
    if (!overlapsQueryBox(context_, level, cells)) return;
    const PyramidParts& parts = context_.pyramid.parts();
    const std::size_t row = parts.brickRow(level, brick);
    if (parts.isRowAbsent(row))
      absent_rows_.push_back(row);
    else if (!context_.mayCross(level, brick))
      return;
    if (!classifier_.mayRefine(level, cells)) return;
    forEachIndex(context_.finerBricks(level, brick),
                 [&](const Index3& child) { findAbsentRows(level - 1, child); });
  }

  void visit(int level, const Index3& brick) {
    context_.checkCancel();
    const IndexBox cells = layout_.brickCellBox(level, brick);
    if (!overlapsQueryBox(context_, level, cells) || !context_.mayCross(level, brick)) return;
    if (classifier_.mayHoldLeaf(level, cells)) {
      const bool is_uniform = isUniform(level, cells);
      if (!is_uniform || !context_.query.has_brick || !context_.query.has_brick(level, brick))
        work_.push_back({level, brick, !is_uniform});
    }
    // Without a refined cell there is nothing finer inside.
    if (!classifier_.mayRefine(level, cells)) return;
    forEachIndex(context_.finerBricks(level, brick),
                 [&](const Index3& child) { visit(level - 1, child); });
  }

  // True if all cells of the brick and all that touch it are leaves of `level`, and are wanted;
  // cells beside a voxel without data are not.
  bool isUniform(int level, const IndexBox& cells) const {
    return classifier_.areAllLeaves(level, cells) && !context_.pyramid.spec().has_missing &&
           (!context_.query.box || liesInQueryBox(level, cells));
  }

  bool liesInQueryBox(int level, const IndexBox& cells) const {
    const Index3 low = context_.lattice().position(level, cells.first);
    const Index3 high = context_.lattice().position(level, cells.end());
    for (int axis = 0; axis < 3; ++axis)
      if (static_cast<double>(low[axis]) < context_.query.box->min[axis] ||
          static_cast<double>(high[axis]) > context_.query.box->max[axis])
        return false;
    return true;
  }

  const MeshContext& context_;
  const BrickLayout& layout_;
  const LeafClassifier classifier_;
  std::vector<BrickWork> work_;
  std::vector<std::size_t> absent_rows_;
};

}  // namespace

std::vector<BrickWork> traverseBricks(const MeshContext& context) {
  return Traversal(context).run();
}

std::vector<BrickWork> traverseFinestBricks(const MeshContext& context, const IndexBox& bricks) {
  return Traversal(context).runFinest(bricks);
}

}  // namespace isobrick
