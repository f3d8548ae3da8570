// The part of a super-brick's file that the join of all of them reads (divided_pyramid.h).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "isobrick/preprocess/level_maker.h"
#include "isobrick/preprocess/voxel_statistics.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// Facts of a super-brick's own voxels, and of how its file was made.
struct HandOverFacts {
  format::Codec codec = format::Codec::kStored;
  ValueRange voxel_range;
};

// The facts, the samples and tile ranges that its last level passes on, and the statistics, as
// bytes.
std::vector<std::byte> handOverOf(const HandOverFacts& facts, const LevelStore& passed_on,
                                  const VoxelStatistics& statistics);

// The way back, of a region's file: writes into the store that all of them share, and adds to the
// statistics. T: the voxel type. False if the bytes are not of that region, or not whole; any bytes
// are safe.
template <typename T>
[[nodiscard]] bool takeHandOver(std::span<const std::byte> bytes, const PyramidSpec& spec,
                                const BuildRegion& region, HandOverFacts& facts, LevelStore& store,
                                VoxelStatistics& statistics);

}  // namespace isobrick
