#include "isobrick/extract/paging/lender_bricks.h"

#include <glm/common.hpp>
#include <utility>

#include "isobrick/storage/index_loop.h"

namespace isobrick {

LenderBricks::LenderBricks(const MeshContext& context, const BrickWork& work,
                           const CrossedTiles& tiles,
                           const std::unordered_set<std::size_t>& planned)
    : context_(context),
      tiles_(tiles),
      planned_(planned),
      layout_(context.pyramid.layout()),
      classifier_(context),
      level_(work.level),
      finer_(work.level - 1),
      cells_(layout_.brickCellBox(level_, work.brick)),
      all_(context.lattice().cells(level_)),
      all_finer_(context.lattice().cells(finer_)) {}

std::vector<PyramidParts::PartAddress> LenderBricks::find() {
  forEachIndex({Index3(0), tiles_.dims()}, [&](const Index3& tile) {
    if (!tiles_.isCrossed(tile)) return;
    const IndexBox leaves =
        CrossedTiles::cellsOf({tile.x, tile.x + 1}, tile.y, tile.z, cells_, layout_.tileCells());
    if (overlapsQueryBox(context_, level_, leaves) && mayTouchFiner(leaves)) visitTile(leaves);
  });
  return std::move(samples_);
}

// The tiles of the finer level over leaves that may touch finer ones.
void LenderBricks::visitTile(const IndexBox& leaves) {
  const Index3 fine_first = leaves.first * std::int64_t{2};
  const Index3 fine_end = glm::min(leaves.end() * std::int64_t{2}, all_finer_);
  const Index3 first = fine_first / layout_.tileCells();
  const Index3 end = (fine_end - Index3(1)) / layout_.tileCells() + Index3(1);
  forEachIndex({first, end - first}, [&](const Index3& finer_tile) {
    const Index3 from = finer_tile * layout_.tileCells();
    const Index3 to = glm::min(from + Index3(layout_.tileCells()), all_finer_);
    const IndexBox coarse{from / std::int64_t{2},
                          (to + Index3(1)) / std::int64_t{2} - from / std::int64_t{2}};
    if (mayTouchFiner(coarse) && mayBeCrossed(finer_tile)) addLenders(coarse);
  });
}

// Whether a leaf in the box of cells may touch a finer one.
bool LenderBricks::mayTouchFiner(const IndexBox& coarse) const {
  const Index3 first = glm::max(coarse.first - Index3(1), Index3(0));
  const IndexBox around{first, glm::min(coarse.end() + Index3(1), all_) - first};
  return classifier_.mayHoldLeaf(level_, coarse) && classifier_.mayRefine(level_, around);
}

bool LenderBricks::mayBeCrossed(const Index3& finer_tile) {
  const Index3 first = finer_tile * layout_.tileCells();
  const Index3 brick = first / layout_.brickCells();
  const std::size_t row = rowOf(brick);
  if (!context_.query.cull_by_ranges || context_.pyramid.parts().isRowAbsent(row)) return true;
  if (!context_.pyramid.brickRange(finer_, brick).crosses(context_.isovalue)) return false;
  if (!planned_.contains(row)) return true;
  const auto [found, is_new] = finer_tiles_.try_emplace(row);
  if (is_new) {
    context_.pyramid.parts().fetch(PartKind::kRanges, finer_, brick, context_.query.cancel);
    found->second.load(context_, finer_, brick);
  }
  const IndexBox own = layout_.brickCellBox(finer_, brick);
  return found->second.isCrossed((first - own.first) / layout_.tileCells());
}

// Adds those of the leaves in a tile. If all of them lie in one brick that was found already, there
// is nothing to find.
void LenderBricks::addLenders(const IndexBox& coarse) {
  const Index3 first = glm::max(coarse.first * std::int64_t{2} - Index3(1), Index3(0));
  const Index3 last = glm::min(coarse.end() * std::int64_t{2}, all_finer_ - Index3(1));
  if (first / layout_.brickCells() == last / layout_.brickCells() &&
      rows_.contains(rowOf(first / layout_.brickCells())))
    return;
  forEachIndex(coarse, [&](const Index3& cell) {
    if (!classifier_.mayHoldLeaf(level_, {cell, Index3(1)})) return;
    for (int corner = 0; corner < 8; ++corner)
      addLender(glm::min(
          (cell + Index3(corner & 1, corner >> 1 & 1, corner >> 2)) * std::int64_t{2}, all_finer_));
  });
}

// That of a corner.
void LenderBricks::addLender(const Index3& fine) {
  const auto lender = lenderOf(
      context_, finer_, fine, Worth::kLeaf,
      [this](const Index3& brick) { return !context_.pyramid.parts().isRowAbsent(rowOf(brick)); },
      [this](const Index3& cell) {
        return classifier_.mayRefine(level_, {cell, Index3(1)});
      });
  if (lender && rows_.insert(rowOf(*lender)).second)
    samples_.push_back({PartKind::kSamples, finer_, *lender});
}

}  // namespace isobrick
