#include "isobrick/preprocess/sources/pyramid_quantity.h"

#include <algorithm>
#include <utility>

#include "isobrick/preprocess/sources/rows_as_boxes.h"
#include "isobrick/storage/curvature_code.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

// A block is what has one value: a tile, a cell of level 1, or a cell.
class QuantitySource final : public VolumeSource {
 public:
  QuantitySource(std::shared_ptr<const Pyramid> pyramid, std::uint64_t budget_bytes,
                 PyramidQuantity quantity, int level, const IndexBox& box, const CancelFlag* cancel)
      : pyramid_(std::move(pyramid)),
        budget_bytes_(budget_bytes),
        quantity_(quantity),
        level_(level),
        cancel_(cancel) {
    const PyramidSpec& spec = pyramid_->spec();
    block_cells_ = quantity == PyramidQuantity::kCurvature ? 2
                   : quantity == PyramidQuantity::kError   ? 1
                                                           : spec.tile_cells;
    brick_blocks_ = spec.brick_cells / block_cells_;
    first_ = box.first / block_cells_;
    info_.voxels = BrickLayout::ceilDivide(box.end() - Index3(1), block_cells_) - first_;
    info_.voxel_type =
        quantity == PyramidQuantity::kCurvature || quantity == PyramidQuantity::kError
            ? VoxelType::kFloat32
            : spec.voxel_type;
    const auto step = static_cast<double>(block_cells_ << level);  // in voxels of level 0
    info_.geometry = spec.geometry;
    info_.geometry.origin =
        spec.geometry.indexToWorld(step * (glm::dvec3(first_) + glm::dvec3(0.5)));
    info_.geometry.spacing *= step;
    info_.source = pyramid_->path();
    info_.format = "isobrick pyramid";
  }

  const VolumeInfo& info() const override { return info_; }
  std::vector<std::string> files() const override { return {pyramid_->path()}; }
  std::string identity() const override { return {}; }
  std::uint64_t bufferBytes() const override { return budget_bytes_; }
  bool readsBoxes() const override { return true; }
  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    readRowsAsBoxes(*this, first, count, out);
  }

  void readBox(const IndexBox& box, void* out) const override {
    const IndexBox blocks{first_ + box.first, box.count};
    const Index3 begin = blocks.first / brick_blocks_;
    const Index3 count = BrickLayout::ceilDivide(blocks.end(), brick_blocks_) - begin;
    isolatedFor(std::int64_t{0}, elementCount(count), [&](std::int64_t i) {
      if (cancel_ != nullptr) cancel_->check();
      const Index3 brick = begin + indexAt(i, count);
      visitVoxelType(info_.voxel_type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        copyBrick(brick, blocks, static_cast<T*>(out));
      });
    });
  }

 private:
  template <typename T>
  void copyBrick(const Index3& brick, const IndexBox& blocks, T* out) const {
    if (quantity_ == PyramidQuantity::kCurvature) {
      std::vector<std::uint8_t> codes;
      pyramid_->curvature(brick, codes);
      copyBlocks(brick, pyramid_->layout().brickNodes(brick), blocks, out, [&](std::size_t i) {
        // Codes are in the order of what they mean; the polynomial is nowhere above all three.
        return CurvatureCode::decode(std::max({codes[3 * i], codes[3 * i + 1], codes[3 * i + 2]}));
      });
    } else if (quantity_ == PyramidQuantity::kError) {
      std::vector<std::uint8_t> codes;
      pyramid_->errorCodes(level_, brick, std::nullopt, codes);
      copyBlocks(brick, pyramid_->layout().brickCellBox(level_, brick).count, blocks, out,
                 [&](std::size_t i) {
                   return ErrorCode::decode(codes[i]) * pyramid_->errorBins().unit();
                 });
    } else {
      std::vector<ValueRange> ranges;
      pyramid_->tileRanges(level_, brick, ranges);
      copyBlocks(brick, pyramid_->layout().brickTiles(level_, brick), blocks, out,
                 [&](std::size_t i) {
                   return quantity_ == PyramidQuantity::kLeast ? ranges[i].min : ranges[i].max;
                 });
    }
  }

  // Those of a brick's `count` blocks that are asked for.
  template <typename T, typename ValueOf>
  void copyBlocks(const Index3& brick, const Index3& count, const IndexBox& blocks, T* out,
                  const ValueOf& valueOf) const {
    const Index3 low = brick * brick_blocks_;
    const Index3 first = glm::max(low, blocks.first), end = glm::min(low + count, blocks.end());
    for (std::int64_t z = first.z; z < end.z; ++z)
      for (std::int64_t y = first.y; y < end.y; ++y)
        for (std::int64_t x = first.x; x < end.x; ++x) {
          const Index3 at(x, y, z);
          out[linearIndex(at - blocks.first, blocks.count)] =
              static_cast<T>(valueOf(static_cast<std::size_t>(linearIndex(at - low, count))));
        }
  }

  std::shared_ptr<const Pyramid> pyramid_;
  std::uint64_t budget_bytes_;
  PyramidQuantity quantity_;
  int level_;
  const CancelFlag* cancel_;
  std::int64_t block_cells_ = 0;   // along an axis
  std::int64_t brick_blocks_ = 0;  // along an axis
  Index3 first_{0};                // block of the level that is voxel (0,0,0)
  VolumeInfo info_;
};

}  // namespace

std::unique_ptr<VolumeSource> makePyramidQuantity(std::shared_ptr<const Pyramid> pyramid,
                                                  std::uint64_t budget_bytes,
                                                  PyramidQuantity quantity, int level,
                                                  const IndexBox& box, const CancelFlag* cancel) {
  const std::string& path = pyramid->path();
  const int levels = quantity == PyramidQuantity::kCurvature ? 1 : pyramid->lattice().levels();
  if (level < 0 || level >= levels)
    throw Error("'" + path + "' has no such quantity of level " + std::to_string(level) +
                    "; choose a level below " + std::to_string(levels),
                {.path = path, .level = level});
  if (quantity == PyramidQuantity::kCurvature && !pyramid->spec().has_curvature)
    throw Error("'" + path + "' was built without curvature", {.path = path},
                {Remedy::kBuildWithCurvature});
  if (quantity == PyramidQuantity::kError &&
      (level < kFirstErrorLevel || level > pyramid->spec().error_level))
    throw Error("'" + path + "' has no bounds of the errors of level " + std::to_string(level) + "",
                {.path = path, .level = level}, {Remedy::kBuildWithErrors});
  return std::make_unique<QuantitySource>(std::move(pyramid), budget_bytes, quantity, level, box,
                                          cancel);
}

}  // namespace isobrick
