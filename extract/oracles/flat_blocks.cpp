#include "isobrick/extract/oracles/flat_blocks.h"

#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/storage/deviation_code.h"

namespace isobrick {

const FlatRows& FlatBlocks::of(const MeshContext& context, const Index3& brick) {
  const PyramidParts& parts = context.pyramid.parts();
  const std::size_t row = parts.brickRow(0, brick);
  if (const auto known = bricks_.find(row); known != bricks_.end()) return known->second;
  std::vector<std::uint8_t> codes;
  std::vector<ValueRange> tiles;
  context.read_log.note(row, ReadLog::kCurvature);
  parts.curvature(brick, codes, context.query.cancel);
  context.tileRanges(0, brick, tiles);
  const BrickLayout& layout = context.pyramid.layout();
  FlatRows rows;
  rows.count = layout.brickCurvatureBlocks(brick);
  rows.bits.resize(static_cast<std::size_t>(rows.count.y * rows.count.z));
  const std::uint8_t* of = codes.data();
  forEachIndex({Index3(0), rows.count}, [&](const Index3& block) {
    const ValueRange range = curvatureBlockRange(layout, brick, tiles, block);
    if (static_cast<double>(deviationBound(of, range, context.isovalue)) <= most_deviation_)
      rows.bits[static_cast<std::size_t>(block.y + rows.count.y * block.z)] |= 1u << block.x;
    of += kDeviationCoefficients;
  });
  return bricks_.emplace(row, std::move(rows)).first->second;
}

}  // namespace isobrick
