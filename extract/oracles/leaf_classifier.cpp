#include "extract/oracles/leaf_classifier.h"

#include "storage/curvature_code.h"

namespace isobrick {
namespace {

using Share = RefinementOracle::Share;

}  // namespace

void LeafClassifier::classify(int level, const IndexBox& cells, std::vector<CellState>& out) {
  const Index3 level_cells = context_.lattice().cells(level);
  const Index3 first = glm::max(cells.first, Index3(0));
  const Index3 end = glm::min(cells.end(), level_cells);
  // A parent decides for its eight cells, so it is asked once.
  const IndexBox parents = parentsOf({first, end - first});
  parent_is_refined_.clear();
  Index3 parent;
  for (parent.z = parents.first.z; parent.z < parents.end().z; ++parent.z)
    for (parent.y = parents.first.y; parent.y < parents.end().y; ++parent.y)
      for (parent.x = parents.first.x; parent.x < parents.end().x; ++parent.x)
        parent_is_refined_.push_back(refines(level + 1, parent) ? 1 : 0);
  out.resize(static_cast<std::size_t>(cells.size()));
  std::size_t at = 0;
  Index3 cell;
  for (cell.z = cells.first.z; cell.z < cells.end().z; ++cell.z)
    for (cell.y = cells.first.y; cell.y < cells.end().y; ++cell.y)
      for (cell.x = cells.first.x; cell.x < cells.end().x; ++cell.x, ++at) {
        if (cell.x < first.x || cell.y < first.y || cell.z < first.z || cell.x >= end.x ||
            cell.y >= end.y || cell.z >= end.z)
          out[at] = CellState::kOutside;
        else if (parent_is_refined_[static_cast<std::size_t>(
                     linearIndex(cell / std::int64_t{2} - parents.first, parents.count))] == 0)
          out[at] = CellState::kCoarser;
        else
          out[at] = level > 0 && refines(level, cell) ? CellState::kFiner : CellState::kLeaf;
      }
}

bool LeafClassifier::mayHoldLeaf(int level, const IndexBox& cells) const {
  if (context_.oracle.shareOfRefined(level + 1, parentsOf(cells)) == Share::kNone) return false;
  return level == 0 || context_.oracle.shareOfRefined(level, cells) != Share::kAll ||
         (level == 1 && curvatureMayAct(cells));
}

bool LeafClassifier::areAllLeaves(int level, const IndexBox& cells) const {
  const Index3 first = glm::max(cells.first - Index3(1), Index3(0));
  const Index3 end = glm::min(cells.end() + Index3(1), context_.lattice().cells(level));
  const IndexBox ring{first, end - first};
  const IndexBox parents = parentsOf(ring);
  if (context_.oracle.shareOfRefined(level + 1, parents) != Share::kAll) return false;
  if (level > 0) return context_.oracle.shareOfRefined(level, ring) == Share::kNone;
  return !curvatureMayAct(parents);
}

bool LeafClassifier::isFlat(const Index3& cell) {
  const BrickLayout& layout = context_.pyramid.layout();
  const Index3 voxel_cell = std::int64_t{2} * cell;
  const Index3 brick = voxel_cell / layout.brickCells();
  const std::size_t row = context_.pyramid.brickRow(0, brick);
  const auto [entry, is_new] = bricks_.try_emplace(row);
  BrickCurvature& data = entry->second;
  if (is_new) {
    context_.read_log.note(row, ReadLog::kCurvature);
    context_.pyramid.curvature(brick, data.coefficients);
    context_.tileRanges(0, brick, data.tile_ranges);
  }
  const Index3 local = voxel_cell - brick * layout.brickCells();
  const ValueRange& range = data.tile_ranges[static_cast<std::size_t>(
      linearIndex(local / layout.tileCells(), layout.brickTiles(0, brick)))];
  const auto node =
      static_cast<std::size_t>(linearIndex(local / std::int64_t{2}, layout.brickNodes(brick)));
  return static_cast<double>(curvatureBound(data.coefficients.data() + 3 * node, range.min,
                                            range.max, context_.isovalue)) <=
         *context_.query.curvature_tolerance;
}

}  // namespace isobrick
