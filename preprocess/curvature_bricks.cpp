#include "preprocess/curvature_bricks.h"

#include "preprocess/curvature_fit.h"
#include "storage/curvature_code.h"
#include "storage/voxel_type.h"

namespace isobrick {

template <typename T>
std::vector<std::uint8_t> brickCurvature(const BrickLayout& layout, const Index3& brick,
                                         const T* samples, const NodeRanges& tiles,
                                         double epsilon) {
  const IndexBox box = layout.brickSampleBox(0, brick);
  const IndexBox cells = layout.brickCellBox(0, brick);
  const Index3 nodes = layout.brickNodes(brick);
  const Index3 last_voxel = layout.lattice().voxels() - Index3(1);
  std::vector<std::uint8_t> codes(static_cast<std::size_t>(3 * elementCount(nodes)), 0);

  FitBlock block;
  std::array<ValueRange, kFitLanes> ranges;
  std::array<std::int64_t, kFitLanes> node_of_lane{};
  std::array<BernsteinCoefficients, kFitLanes> coefficients;
  std::size_t lanes = 0;
  const auto fitLanes = [&] {
    for (std::size_t i = lanes; i < kFitLanes; ++i) ranges[i] = {0, 0};  // values left over: unused
    fitCurvature(block, ranges, static_cast<float>(epsilon), coefficients);
    for (std::size_t i = 0; i < lanes; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        codes[static_cast<std::size_t>(3 * node_of_lane[i]) + j] =
            CurvatureCode::encodeUp(static_cast<double>(coefficients[i][j]));
    lanes = 0;
  };

  for (FitBlock::value_type& voxel : block) voxel.fill(0);
  Index3 node;
  for (node.z = 0; node.z < nodes.z; ++node.z)
    for (node.y = 0; node.y < nodes.y; ++node.y)
      for (node.x = 0; node.x < nodes.x; ++node.x) {
        const Index3 first = cells.first + std::int64_t{2} * node;
        const ValueRange& range = tiles.at(first / layout.tileCells());
        if (range.min == range.max) continue;  // nothing to bound
        ranges[lanes] = range;
        node_of_lane[lanes] = linearIndex(node, nodes);
        std::size_t voxel = 0;
        for (std::int64_t z = 0; z < 3; ++z)
          for (std::int64_t y = 0; y < 3; ++y)
            for (std::int64_t x = 0; x < 3; ++x) {
              const Index3 at = glm::min(first + Index3(x, y, z), last_voxel) - box.first;
              block[voxel++][lanes] = static_cast<float>(samples[linearIndex(at, box.count)]);
            }
        if (++lanes == kFitLanes) fitLanes();
      }
  if (lanes > 0) fitLanes();
  return codes;
}

#define ISOBRICK_INSTANTIATE(T)                                                           \
  template std::vector<std::uint8_t> brickCurvature<T>(const BrickLayout&, const Index3&, \
                                                       const T*, const NodeRanges&, double);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
