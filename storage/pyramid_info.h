// Facts of a pyramid as a whole.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/value_transform.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

namespace format {

// How samples of a level become those of the next coarser one; the numbers are those of the file.
enum class Filter : std::uint32_t {
  kAverage = 0,    // [1 2 1]/4 along each axis
  kSubsample = 1,  // every other sample as it is
};
// How the bytes of a part are packed; the numbers are those of the file.
enum class Codec : std::uint32_t {
  kStored = 0,    // the bytes themselves
  kConstant = 1,  // no bytes: samples and ranges all have the brick's constant, curvature is 0
  kAbsent = 2,    // no bytes: the part was not made: the curvature of coarser levels, or of no use
  kLz4 = 3,       // a Blosc buffer, packed with LZ4
  kZstd = 4,      // a Blosc buffer, packed with Zstandard; of differences (docs/FORMAT.md)
  kInSource = 5,  // no bytes: samples of level 0 that lie in the source (Level0Place)
};

}  // namespace format

// How the bytes of a file come into memory.
enum class FileAccess {
  kMap,   // parts that can be used in place are mapped; the rest is read
  kRead,  // everything is read, nothing is mapped: for remote file systems
};

// Where the samples of level 0 lie; the numbers are those of the file.
enum class Level0Place : std::uint32_t {
  kStored = 0,     // in the pyramid
  kInFiles = 1,    // in the files that the pyramid was made of, which stay beside it
  kBehindUrl = 2,  // in objects of a server that it was made of
};

// The properties of a pyramid that are fixed before its first brick is written.
struct PyramidSpec {
  Index3 voxels{0};                          // per axis 2 .. kMaxVoxelsPerAxis
  VoxelType voxel_type = VoxelType::kUint8;  // of the samples of all levels
  GridGeometry geometry;                     // the voxels' place in the world
  // From stored samples to the values of the input. Samples, ranges, histogram and noise of a
  // pyramid are stored numbers; isovalues of queries, and all that users see, are the input's.
  ValueTransform values;
  // From a level to the next coarser one.
  format::Filter filter = format::Filter::kAverage;
  std::int64_t brick_cells = 64;  // power of two, 4 .. 256
  std::int64_t tile_cells = 4;    // power of two, 2 .. brick_cells
  bool has_curvature = true;      // whether there are bounds of the curvature
  // Samples with |gradient| < curvature_epsilon * (range of their block) per voxel do not count for
  // the curvature bound: an isosurface is nowhere in particular if the gradient vanishes.
  double curvature_epsilon = 1.0 / 64;
  // Samples of float32 may be NaN: voxels without data, which no range takes in. A sample is NaN on
  // every level on which its voxel has a place, and nowhere else.
  bool has_missing = false;
  // An index (`isobrick build --index`) leaves level 0 in its source. Reading it takes
  // storage/source_bricks.h.
  Level0Place level0 = Level0Place::kStored;

  // How levels are cut into bricks.
  BrickLayout layout() const { return {Lattice(voxels), brick_cells, tile_cells}; }
};

// The bytes of a file, by kind.
struct PyramidBytes {
  std::uint64_t total = 0;           // of the file
  std::uint64_t raw = 0;             // voxels of level 0 without anything around them
  std::uint64_t samples_level0 = 0;  // bricks of level 0, aprons included
  // The part of samples_level0 that another brick holds too; of a packed brick in proportion.
  std::uint64_t aprons_level0 = 0;
  std::uint64_t samples_coarser = 0;  // of all other levels
  std::uint64_t ranges = 0;           // of tiles
  std::uint64_t curvature = 0;        // bounds of it
  std::uint64_t index = 0;            // header, tables, histogram, provenance and alignment
};

// How many bricks have a part in each codec; the index is the codec's number.
using CodecCounts = std::array<std::uint64_t, 6>;
// The codec counts of every kind of part.
struct PyramidCodecs {
  CodecCounts samples{};    // of bricks
  CodecCounts ranges{};     // of tiles
  CodecCounts curvature{};  // bounds of it
};

// Sums over the whole brick table.
struct PyramidSums {
  PyramidBytes bytes;    // of the file, by kind
  PyramidCodecs codecs;  // of the parts, by kind
};

// "stored", "constant", "absent", "lz4", "zstd" or "source".
constexpr std::string_view codecName(format::Codec codec) {
  constexpr std::string_view kNames[] = {"stored", "constant", "absent", "lz4", "zstd", "source"};
  static_assert(std::size(kNames) == std::tuple_size_v<CodecCounts>);
  return kNames[static_cast<std::uint32_t>(codec)];
}

// "average" or "subsample".
constexpr std::string_view filterName(format::Filter filter) {
  return filter == format::Filter::kAverage ? "average" : "subsample";
}

}  // namespace isobrick
