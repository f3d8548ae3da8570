// What is known of a pyramid as a whole.
#pragma once

#include <array>
#include <string_view>

#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/value_range.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// Fixed before the first brick is written.
struct PyramidSpec {
  Index3 voxels{0};  // per axis 2 .. kMaxVoxelsPerAxis
  VoxelType voxel_type = VoxelType::kUint8;
  GridGeometry geometry;
  format::Filter filter = format::Filter::kAverage;
  std::int64_t brick_cells = 64;  // power of two, 4 .. 256
  std::int64_t tile_cells = 4;    // power of two, 2 .. brick_cells
  bool has_curvature = true;
  // Samples with |gradient| < curvature_epsilon * (range of their tile) per voxel do not count for
  // the curvature bound: the isosurface has no curvature where the gradient vanishes.
  double curvature_epsilon = 1.0 / 64;
  // The last level whose cells have bounds of their error (error_bins.h), from level 2 on; 0: none
  // have.
  int error_level = 0;

  BrickLayout layout() const { return {Lattice(voxels), brick_cells, tile_cells}; }
};

// Where the bytes of a file are, by kind.
struct PyramidBytes {
  std::uint64_t total = 0;
  std::uint64_t raw = 0;             // voxels of level 0 without anything around them
  std::uint64_t samples_level0 = 0;  // bricks of level 0, aprons included
  // The part of samples_level0 that another brick holds too; of a packed brick in proportion.
  std::uint64_t aprons_level0 = 0;
  std::uint64_t samples_coarser = 0;
  std::uint64_t ranges = 0;
  std::uint64_t curvature = 0;
  std::uint64_t error = 0;
  std::uint64_t index = 0;  // header, tables, histogram, provenance and alignment
};

// How many bricks have a part in each codec; the index is the codec's number.
using CodecCounts = std::array<std::uint64_t, 5>;
struct PyramidCodecs {
  CodecCounts samples{}, ranges{}, curvature{}, error{};
};

struct PyramidSums {
  PyramidBytes bytes;
  PyramidCodecs codecs;
};

// "stored", "constant", "absent", "lz4" or "zstd".
constexpr std::string_view codecName(format::Codec codec) {
  constexpr std::string_view kNames[] = {"stored", "constant", "absent", "lz4", "zstd"};
  static_assert(std::size(kNames) == std::tuple_size_v<CodecCounts>);
  return kNames[static_cast<std::uint32_t>(codec)];
}

// "average" or "subsample".
constexpr std::string_view filterName(format::Filter filter) {
  return filter == format::Filter::kAverage ? "average" : "subsample";
}

}  // namespace isobrick
