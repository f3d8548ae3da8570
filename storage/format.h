// The `.isb` file, versions 3 to 5, as it lies on disk; docs/FORMAT.md is its specification in
// words.
//
//   header (512 bytes)
//   parts of bricks, in the order of the brick table: those of the kinds that the header lists
//   histogram     (counts of the voxels of level 0 by value)
//   gradients     (how steep level 0 is along the isosurface of every value)
//   level table   (a LevelRow for each level)
//   brick table   (a row for each brick; those of level 0 first, x fastest): a PartEntry for each
//                 kind, then a RowTail
//   provenance    (JSON, UTF-8)
//
// All numbers are little-endian. Structs have no padding; a big-endian host is refused at compile
// time. Everything read from here is hostile until pyramid_tables.cpp has checked it.
#pragma once

#include <bit>
#include <cstdint>
#include <type_traits>

#include "isobrick/storage/pyramid_info.h"  // Filter, Codec

namespace isobrick::format {

static_assert(std::endian::native == std::endian::little, "isobrick needs a little-endian host");

inline constexpr char kMagic[8] = {'I', 'S', 'O', 'B', 'R', 'I', 'C', 'K'};
// The least version that holds a file is written: 3; 4 if values are transformed, or if some voxels
// have no data; 5 if level 0 lies in the source.
inline constexpr std::uint32_t kVersion = 3;
inline constexpr std::uint32_t kVersionOfTransforms = 4;
inline constexpr std::uint32_t kVersionOfSources = 5;
// Voxels that are labels, u64, from version 4 on: no program writes them yet.
inline constexpr std::uint32_t kLabelVoxels = 5;

// Stored samples of at least this many bytes begin at multiples of it, so that a brick can be paged
// and used in place; fewer begin at kPartAlignment.
inline constexpr std::uint64_t kSampleAlignment = 4096;
// A header lists at most so many kinds of parts.
inline constexpr std::uint32_t kMostKinds = 8;
// The kind of the error bounds that development builds of 0.2 wrote. Readers pass over them, as
// over 2, bounds of the curvature of single cells.
inline constexpr std::uint32_t kErrorKind = 3;
// Tables and the other parts begin at multiples of this.
inline constexpr std::uint64_t kPartAlignment = 64;

// The place of a part of a brick, of the histogram, or of the gradients.
struct PartEntry {
  std::uint64_t offset;        // from the start of the file; 0 if there are no bytes
  std::uint64_t checksum;      // XXH3-64 of the stored bytes; 0 if there are none
  std::uint32_t stored_bytes;  // size in the file
  std::uint32_t codec;
};
static_assert(sizeof(PartEntry) == 24);

struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t header_bytes;  // sizeof(Header)
  std::uint64_t file_bytes;    // size of the whole file: a shorter file was truncated
  std::uint32_t voxel_type;
  std::uint32_t filter;
  std::uint32_t level_count;
  std::uint32_t brick_cells;  // cells per brick and axis: a power of two, 4 .. 256
  std::uint32_t tile_cells;   // cells per tile and axis: a power of two, 2 .. brick_cells
  std::uint32_t kind_count;   // entries of `kinds`, 2 .. kMostKinds
  std::uint64_t dims[3];      // voxels per axis
  double spacing[3];
  double origin[3];
  double direction[9];  // column-major: world direction of index axis x, then y, then z
  double value_min, value_max;
  double curvature_epsilon;  // samples with |gradient| < epsilon * (range of the tile) are left out
  std::uint64_t level_table_offset;
  std::uint64_t level_table_checksum;
  std::uint64_t brick_table_offset;
  std::uint64_t brick_count;
  std::uint64_t provenance_offset;
  std::uint64_t provenance_bytes;
  std::uint64_t provenance_checksum;
  PartEntry histogram;               // see voxel_histogram.h
  double noise;                      // sigma of the voxels' noise, in their units; finite, >= 0
  std::uint32_t kinds[kMostKinds];   // kinds of the parts of a row, ascending: PartKind, or newer
  std::uint8_t error_bins[24];       // of kErrorKind; zero without it
  std::uint32_t length_unit;         // LengthUnit, of spacing and origin
  std::uint8_t reserved_between[4];  // zero
  PartEntry gradients;               // see gradient_spectrum.h; all zero if there are none
  // For a file of a divided pyramid; all zero for a pyramid in one file.
  std::uint32_t super_cells;   // cells of level 0 along an edge of a super-brick
  std::uint32_t super_levels;  // levels 0 .. super_levels - 1 lie in files of super-bricks
  std::uint64_t super_brick;   // 0: this is the index; else the number of the super-brick, plus 1
  PartEntry division;  // stored as it is; of the index: FileEntry for every super-brick, then
                       // a Range for every brick of level super_levels - 1
  double value_scale;  // of ValueTransform; both zero in version 3, which has none
  double value_offset;
  std::uint64_t missing_voxels;   // from version 4 on: NaN voxels of level 0, which have no data
  std::uint32_t level0_place;     // of version 5: Level0Place, not 0; before that zero
  std::uint8_t reserved[44];      // zero
  std::uint64_t header_checksum;  // XXH3-64 of all the bytes before it
};
static_assert(sizeof(Header) == 512 && std::is_trivially_copyable_v<Header>);

// Row of the level table.
struct LevelRow {
  std::uint64_t samples[3];
  std::uint64_t bricks[3];
  std::uint64_t first_brick;  // row of the brick table; kNoRow of levels that it has not
};
static_assert(sizeof(LevelRow) == 56);
inline constexpr std::uint64_t kNoRow = ~std::uint64_t{0};

// A super-brick's file as the index of a divided pyramid has it.
struct FileEntry {
  std::uint64_t file_bytes;
  std::uint64_t header_checksum;     // as in the file's header
  std::uint64_t brick_table_offset;  // likewise
  // Closures of bricks whose rows, in that file, lack values of coarser levels: in the index, their
  // rows, u32, ascending; then range_min of all, f32; then range_max.
  PartEntry corrections;
  std::uint32_t correction_count;
  std::uint32_t reserved;  // zero
};
static_assert(sizeof(FileEntry) == 56);

// A closure, as in RowTail.
struct Range {
  float min, max;
};
static_assert(sizeof(Range) == 8);

// The end of a row of the brick table, after `kind_count` PartEntries.
struct RowTail {
  float range_min, range_max;  // closure over the brick's cells (rule 7)
  float constant;              // the value of samples whose codec is kConstant
  std::uint32_t error_bytes;   // of kErrorKind; zero without it
  std::uint64_t checksum;      // XXH3-64 of the row's bytes before it; the seed is the row's number
};
static_assert(sizeof(RowTail) == 24);

// Bytes of a row of the brick table.
constexpr std::uint64_t rowBytes(std::uint32_t kind_count) {
  return kind_count * sizeof(PartEntry) + sizeof(RowTail);
}

}  // namespace isobrick::format
