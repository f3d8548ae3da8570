#include "isobrick/extract/oracles/curvature_oracle.h"

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/storage/curvature_code.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

CurvatureOracle::CurvatureOracle(const MeshContext& context, const DetailChoice& choice)
    : context_(&context),
      is_on_(choice.curvature_tolerance.has_value()),
      tolerance_(choice.curvature_tolerance.value_or(0)) {
  if (!choice.focus) return;
  center_ = choice.focus->center;
  radius_squared_ = choice.focus->radius * choice.focus->radius;
}

bool CurvatureOracle::isFlat(const Index3& cell) {
  const BrickLayout& layout = context_->pyramid.layout();
  const Index3 voxel_cell = std::int64_t{2} * cell;
  const Index3 brick = voxel_cell / layout.brickCells();
  const BrickCurvature& curvature = curvatureOf(brick);
  const Index3 local = voxel_cell - brick * layout.brickCells();
  const ValueRange& range = curvature.tile_ranges[static_cast<std::size_t>(
      linearIndex(local / layout.tileCells(), layout.brickTiles(0, brick)))];
  const auto node =
      static_cast<std::size_t>(linearIndex(local / std::int64_t{2}, layout.brickNodes(brick)));
  return static_cast<double>(curvatureBound(curvature.coefficients.data() + 3 * node, range.min,
                                            range.max, context_->isovalue)) <= tolerance_;
}

void CurvatureOracle::keepRefined(int level, const Index3& first, std::int64_t count,
                                  std::uint64_t* bits) {
  if (level != 1 || !is_on_) return;
  keepBitsWhere(bits, wordsOf(count), [&](std::int64_t i) {
    return refines(1, {first.x + i, first.y, first.z});
  });
}

const CurvatureOracle::BrickCurvature& CurvatureOracle::curvatureOf(const Index3& brick) {
  const std::size_t row = context_->pyramid.parts().brickRow(0, brick);
  if (last_ != nullptr && last_row_ == row) return *last_;
  const auto [entry, is_new] = bricks_.try_emplace(row);
  if (is_new) {
    context_->read_log.note(row, ReadLog::kCurvature);
    context_->pyramid.parts().curvature(brick, entry->second.coefficients, context_->query.cancel);
    context_->tileRanges(0, brick, entry->second.tile_ranges);
  }
  last_row_ = row;
  last_ = &entry->second;  // stays where it is when others come
  return entry->second;
}

}  // namespace isobrick
