#include "extract/brick_traversal.h"

namespace isobrick {
namespace {

using Share = RefinementOracle::Share;

// The smallest box of cells of the next coarser level that covers `cells`.
IndexBox parentsOf(const IndexBox& cells) {
  const Index3 first = cells.first / std::int64_t{2};
  const Index3 last = (cells.end() - Index3(1)) / std::int64_t{2};
  return {first, last - first + Index3(1)};
}

class Traversal {
 public:
  explicit Traversal(const MeshContext& context)
      : context_(context), layout_(context.pyramid.layout()) {}

  std::vector<BrickWork> run() {
    const int top = context_.lattice().levels() - 1;
    visit(top, Index3(0));  // the coarsest level is one cell
    return std::move(work_);
  }

 private:
  void visit(int level, const Index3& brick) {
    if (context_.query.cancel != nullptr) context_.query.cancel->check();
    const IndexBox cells = layout_.brickCellBox(level, brick);
    if (!overlapsQueryBox(context_, level, cells)) return;
    if (context_.query.cull_by_ranges &&
        !context_.pyramid.brickRange(level, brick).crosses(context_.isovalue))
      return;
    const Share parents = context_.oracle.shareOfRefined(level + 1, parentsOf(cells));
    if (parents == Share::kNone) return;  // all inside coarser leaves
    const Share own = level > 0 ? context_.oracle.shareOfRefined(level, cells) : Share::kNone;
    if (own != Share::kAll || (level == 1 && curvatureMayAct(cells)))
      work_.push_back({level, brick, !isUniform(level, cells)});
    if (own == Share::kNone) return;
    const Index3 first = 2L * brick;
    const Index3 end = glm::min(first + Index3(2), layout_.bricks(level - 1));
    Index3 child;
    for (child.z = first.z; child.z < end.z; ++child.z)
      for (child.y = first.y; child.y < end.y; ++child.y)
        for (child.x = first.x; child.x < end.x; ++child.x) visit(level - 1, child);
  }

  bool curvatureMayAct(const IndexBox& cells_of_level1) const {
    return context_.hasCurvatureOracle() && context_.oracle.curvatureMayApply(cells_of_level1);
  }

  // True where all cells of the box and all that touch it are leaves of `level`.
  bool isUniform(int level, const IndexBox& cells) const {
    const Index3 first = glm::max(cells.first - Index3(1), Index3(0));
    const Index3 end = glm::min(cells.end() + Index3(1), context_.lattice().cells(level));
    const IndexBox ring{first, end - first};
    if (context_.oracle.shareOfRefined(level + 1, parentsOf(ring)) != Share::kAll) return false;
    if (level > 0 && context_.oracle.shareOfRefined(level, ring) != Share::kNone) return false;
    if (level == 0 && curvatureMayAct(parentsOf(ring))) return false;
    return !context_.query.box || liesInQueryBox(level, cells);
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
  std::vector<BrickWork> work_;
};

}  // namespace

std::vector<BrickWork> traverseBricks(const MeshContext& context) {
  return Traversal(context).run();
}

}  // namespace isobrick
