#include <tbb/parallel_for.h>

#include <cstring>

#include "isobrick/storage/pyramid.h"
#include "tools/bench/peers/peer_engines.h"

namespace isobrick {
namespace {

// The memory for the file while it is read; little, as it counts against the peer.
constexpr std::uint64_t kBudgetBytes = 64 << 20;

// The rows of a brick that no other brick has to the dense block `out`.
void copyBrick(const Pyramid& pyramid, const Index3& brick, std::byte* out) {
  const Index3 voxels = pyramid.lattice().voxels();
  const std::size_t voxel_bytes = voxelBytes(pyramid.spec().voxel_type);
  const BrickSamples samples = pyramid.samples(0, brick);
  const IndexBox cells = pyramid.layout().brickCellBox(0, brick);
  // A volume has one voxel more on each axis than it has cells: the last brick's.
  const Index3 is_last(glm::equal(cells.end(), voxels - Index3(1)));
  const Index3 end = cells.end() + is_last;
  Index3 at = cells.first;
  for (at.z = cells.first.z; at.z < end.z; ++at.z)
    for (at.y = cells.first.y; at.y < end.y; ++at.y)
      std::memcpy(out + static_cast<std::size_t>(linearIndex(at, voxels)) * voxel_bytes,
                  samples.part.data() + static_cast<std::size_t>(linearIndex(at - samples.box.first,
                                                                             samples.box.count)) *
                                            voxel_bytes,
                  static_cast<std::size_t>(end.x - at.x) * voxel_bytes);
  pyramid.throwIfReadsFailed(0, brick);
}

}  // namespace

Level0Volume::Level0Volume(const std::string& path)
    : pyramid_(std::make_unique<Pyramid>(path, kBudgetBytes)) {}
Level0Volume::~Level0Volume() = default;

std::array<std::int64_t, 3> Level0Volume::voxels() const {
  const Index3& voxels = pyramid_->lattice().voxels();
  return {voxels.x, voxels.y, voxels.z};
}

std::array<double, 3> Level0Volume::spacing() const {
  const glm::dvec3& spacing = pyramid_->spec().geometry.spacing;
  return {spacing.x, spacing.y, spacing.z};
}

std::string Level0Volume::typeName() const {
  return std::string(voxelTypeName(pyramid_->spec().voxel_type));
}

std::size_t Level0Volume::bytes() const {
  return static_cast<std::size_t>(elementCount(pyramid_->lattice().voxels())) *
         voxelBytes(pyramid_->spec().voxel_type);
}

double Level0Volume::leastVoxel() const { return static_cast<double>(pyramid_->valueRange().min); }

void Level0Volume::copyTo(void* out) const {
  const Index3 bricks = pyramid_->layout().bricks(0);
  tbb::parallel_for(std::int64_t{0}, elementCount(bricks), [&](std::int64_t i) {
    const Index3 brick(i % bricks.x, i / bricks.x % bricks.y, i / (bricks.x * bricks.y));
    copyBrick(*pyramid_, brick, static_cast<std::byte*>(out));
  });
}

}  // namespace isobrick
