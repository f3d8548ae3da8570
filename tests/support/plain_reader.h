// A second reader of `.isb` files, written from docs/FORMAT.md alone: it shares no code with
// storage/ and preprocess/, so that the tests compare the document with the writer. Packed parts it
// hands to Blosc's own decompress call. It reads the whole file at once and keeps everything in
// plain vectors; slow and simple on purpose.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace isobrick::test {

using PlainIndex = std::array<std::int64_t, 3>;

// Where a part of a brick lies in the file.
struct PlainPart {
  std::uint64_t offset = 0;
  std::uint64_t checksum = 0;
  std::uint32_t stored_bytes = 0;
  std::uint32_t codec = 0;
};

struct PlainRange {
  float min = 0, max = 0;
  bool operator==(const PlainRange&) const = default;
};

struct PlainBrick {
  int level = 0;
  PlainIndex index{};
  PlainIndex first_cell{}, cells{};    // of its level
  PlainIndex first_sample{}, count{};  // what `samples` holds
  std::vector<float> samples;          // none if they are in the source
  PlainIndex tiles{};
  std::vector<PlainRange> tile_ranges;
  PlainIndex blocks{};
  std::vector<std::uint8_t>
      codes;  // eight a block, 255 where absent; of level 0, if the file has them
  PlainRange range;
  std::array<PlainPart, 3> parts;  // samples, ranges, curvature; one that is not listed is absent

  float sampleAt(const PlainIndex& sample) const;  // by its index in the level
  // The range of the tile that holds `cell` of the brick's level.
  PlainRange tileRangeOfCell(const PlainIndex& cell, std::int64_t tile_cells) const;
};

struct PlainLevel {
  PlainIndex samples{}, bricks{};
  std::uint64_t first_brick = 0;
};

struct PlainPyramid {
  std::uint64_t file_bytes = 0;
  std::uint32_t voxel_type = 0, filter = 0;
  std::int64_t brick_cells = 0, tile_cells = 0;
  bool has_curvature = false;
  bool is_index = false;  // section 15: level 0 is in the source
  PlainIndex dims{};
  std::array<double, 3> spacing{}, origin{};
  std::array<double, 9> direction{};
  std::uint32_t length_unit = 0;
  double value_min = 0, value_max = 0, curvature_epsilon = 0, noise = 0;
  double value_scale = 1, value_offset = 0;  // from version 4 on
  std::uint64_t missing_voxels = 0;          // likewise
  std::vector<std::uint32_t> kinds;          // of the parts of a row
  std::vector<std::uint64_t> histogram;      // section 10
  std::vector<float> gradients;              // section 10; empty where there are none
  std::vector<PlainLevel> levels;
  std::vector<PlainBrick> bricks;
  std::string provenance;
  // One entry for every byte of the file: whether a checksum (or the magic) covers it.
  std::vector<bool> covered;
  std::uint64_t level_table_offset = 0, brick_table_offset = 0, provenance_offset = 0;

  const PlainBrick& brickAt(int level, const PlainIndex& index) const;
};

// Throws std::runtime_error where the file breaks a rule of docs/FORMAT.md section 12.
PlainPyramid readPlainPyramid(const std::string& path);

std::vector<std::uint8_t> readWholeFile(const std::string& path);

// Sections 7 and 8.
std::int64_t plainBlockCells(const PlainPyramid& pyramid);
double plainDeviationOfCode(std::uint8_t code);
PlainRange plainBlockRange(const PlainPyramid& pyramid, const PlainBrick& brick,
                           const PlainIndex& block);
double plainDeviationBound(const std::uint8_t codes[8], const PlainRange& range, double value);

}  // namespace isobrick::test
