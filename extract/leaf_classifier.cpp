#include "extract/leaf_classifier.h"

#include "storage/curvature_code.h"

namespace isobrick {

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
