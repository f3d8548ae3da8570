#include "isobrick/extract/oracles/curvature_oracle.h"

#include <algorithm>
#include <bit>

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

std::int64_t logarithmOf(std::int64_t power_of_two) {
  return std::countr_zero(static_cast<std::uint64_t>(power_of_two));
}

}  // namespace

CurvatureOracle::CurvatureOracle(const MeshContext& context, const DetailChoice& choice,
                                 FlatBlocks* flat, BrickReads reads)
    : context_(&context),
      flat_(flat),
      may_read_(reads == BrickReads::kAllowed && context.residency == nullptr) {
  const BrickLayout& layout = context.pyramid.layout();
  cells_shift_ = logarithmOf(layout.curvatureCells() / 2);
  blocks_shift_ = logarithmOf(layout.brickCells() / layout.curvatureCells());
  if (!choice.focus) return;
  center_ = choice.focus->center;
  radius_squared_ = choice.focus->radius * choice.focus->radius;
}

void CurvatureOracle::keepRefined(int level, const Index3& first, std::int64_t count,
                                  std::uint64_t* bits) const {
  if (level != 1 || flat_ == nullptr) return;
  const RowDistance distance(center_, 1, first);
  const std::int64_t edge = std::int64_t{1} << cells_shift_;
  for (std::int64_t begin = 0, end = 0; begin < count; begin = end) {
    end = std::min(begin + edge - (first.x + begin) % edge, count);
    // What is not asked for may not be resident.
    bool is_any_asked = false;
    for (std::int64_t i = begin; i < end; ++i)
      is_any_asked = is_any_asked || (bits[i / 64] >> i % 64 & 1) != 0;
    if (!is_any_asked || !isFlat((first + Index3(begin, 0, 0)) >> cells_shift_)) continue;
    // Between two cells of a row in the sphere all others are in it.
    const bool is_all_inside =
        distance.squared(begin) <= radius_squared_ && distance.squared(end - 1) <= radius_squared_;
    for (std::int64_t i = begin; i < end; ++i)
      if (is_all_inside || distance.squared(i) <= radius_squared_)
        bits[i / 64] &= ~(std::uint64_t{1} << i % 64);
  }
}

Coverage CurvatureOracle::refinedCoverage(int level, const IndexBox& cells) const {
  if (level != 1 || flat_ == nullptr) return Coverage::kAll;
  const DistanceBounds distance = squaredDistanceBounds(center_, 1, cells);
  if (distance.least > radius_squared_) return Coverage::kAll;
  if (!may_read_) return Coverage::kSome;
  const Index3 first = cells.first >> cells_shift_;
  const Index3 last = (cells.end() - Index3(1)) >> cells_shift_;
  const Index3 first_brick = first >> blocks_shift_;
  bool is_any_flat = false, is_all_flat = true;
  forEachIndex(
      {first_brick, (last >> blocks_shift_) - first_brick + Index3(1)}, [&](const Index3& brick) {
        const FlatRows& rows = rowsOf(brick);
        const Index3 own = brick << blocks_shift_;
        const Index3 begin = glm::max(first - own, Index3(0));
        const Index3 end = glm::min(last - own + Index3(1), rows.count);
        const auto mask =
            static_cast<std::uint32_t>((std::uint64_t{1} << end.x) - (std::uint64_t{1} << begin.x));
        for (std::int64_t z = begin.z; z < end.z; ++z)
          for (std::int64_t y = begin.y; y < end.y; ++y) {
            const std::uint32_t flat =
                rows.bits[static_cast<std::size_t>(y + rows.count.y * z)] & mask;
            is_any_flat = is_any_flat || flat != 0;
            is_all_flat = is_all_flat && flat == mask;
          }
      });
  if (!is_any_flat) return Coverage::kAll;
  return is_all_flat && distance.greatest <= radius_squared_ ? Coverage::kNone : Coverage::kSome;
}

bool CurvatureOracle::isFlat(const Index3& block) const {
  const Index3 brick = block >> blocks_shift_;
  const FlatRows& rows = rowsOf(brick);
  const Index3 at = block - (brick << blocks_shift_);
  return (rows.bits[static_cast<std::size_t>(at.y + rows.count.y * at.z)] >> at.x & 1) != 0;
}

const FlatRows& CurvatureOracle::rowsOf(const Index3& brick) const {
  if (last_ == nullptr || last_brick_ != brick) {
    last_ = &flat_->of(*context_, brick);
    last_brick_ = brick;
  }
  return *last_;
}

}  // namespace isobrick
