#include "tests/support/plain_reader.h"

#include <blosc.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <stdexcept>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace isobrick::test {
std::int64_t plainBlockCells(const PlainPyramid& p) {
  const std::int64_t wanted = std::max({p.dims[0], p.dims[1], p.dims[2]}) <= 128 ? 8 : 16;
  return std::max(p.tile_cells, std::min(wanted, p.brick_cells));
}

namespace {

void require(bool holds, const std::string& what) {
  if (!holds) throw std::runtime_error("plain reader: " + what);
}

std::int64_t ceilOf(std::int64_t a, std::int64_t b) { return (a + b - 1) / b; }

std::int64_t product(const PlainIndex& dims) { return dims[0] * dims[1] * dims[2]; }

std::size_t positionIn(const PlainIndex& index, const PlainIndex& dims) {
  return static_cast<std::size_t>((index[2] * dims[1] + index[1]) * dims[0] + index[0]);
}

bool isPowerOfTwo(std::int64_t value) { return value > 0 && (value & (value - 1)) == 0; }

// Numbers are little-endian in the file; put together byte by byte, so on any host.
std::uint64_t numberAt(const std::uint8_t* from, int bytes) {
  std::uint64_t value = 0;
  for (int i = bytes - 1; i >= 0; --i) value = value << 8 | from[i];
  return value;
}

float voxelAt(const std::uint8_t* from, std::uint32_t type) {
  switch (type) {
    case 0:
      return static_cast<float>(static_cast<std::uint8_t>(numberAt(from, 1)));
    case 1:
      return static_cast<float>(static_cast<std::int8_t>(numberAt(from, 1)));
    case 2:
      return static_cast<float>(static_cast<std::uint16_t>(numberAt(from, 2)));
    case 3:
      return static_cast<float>(static_cast<std::int16_t>(numberAt(from, 2)));
    default: {
      const auto bits = static_cast<std::uint32_t>(numberAt(from, 4));
      float value;
      std::memcpy(&value, &bits, sizeof value);
      return value;
    }
  }
}

class FileBytes {
 public:
  explicit FileBytes(const std::string& path)
      : bytes_(readWholeFile(path)), covered_(bytes_.size(), false) {}

  std::uint64_t size() const { return bytes_.size(); }
  bool holds(std::uint64_t offset, std::uint64_t bytes) const {
    return offset <= size() && bytes <= size() - offset;
  }
  const std::uint8_t* at(std::uint64_t offset, std::uint64_t bytes) const {
    require(holds(offset, bytes), "a read past the end of the file");
    return bytes_.data() + offset;
  }
  std::uint64_t number(std::uint64_t offset, int bytes) const {
    return numberAt(at(offset, static_cast<std::uint64_t>(bytes)), bytes);
  }
  std::uint32_t u32(std::uint64_t offset) const {
    return static_cast<std::uint32_t>(number(offset, 4));
  }
  std::uint64_t u64(std::uint64_t offset) const { return number(offset, 8); }
  float f32(std::uint64_t offset) const { return voxelAt(at(offset, 4), 4); }
  double f64(std::uint64_t offset) const {
    const std::uint64_t bits = u64(offset);
    double value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }
  // Checks the hash of a part or table, and that no other holds its bytes.
  void checkHash(std::uint64_t offset, std::uint64_t bytes, std::uint64_t hash,
                 const std::string& what) {
    require(XXH3_64bits(at(offset, bytes), bytes) == hash, "wrong checksum of " + what);
    cover(offset, bytes, what);
  }
  void cover(std::uint64_t offset, std::uint64_t bytes, const std::string& what) {
    for (std::uint64_t i = offset; i < offset + bytes; ++i) {
      require(!covered_[i], what + " overlaps another part");
      covered_[i] = true;
    }
  }
  void requireZeroPadding() const {
    for (std::size_t i = 0; i < bytes_.size(); ++i)
      require(covered_[i] || bytes_[i] == 0, "padding that is not zero");
  }
  std::vector<bool> takeCovered() { return std::move(covered_); }

 private:
  std::vector<std::uint8_t> bytes_;
  std::vector<bool> covered_;
};

constexpr std::uint32_t kVoxelSizes[5] = {1, 1, 2, 2, 4};

PlainPyramid readHeader(FileBytes& file) {
  PlainPyramid p;
  require(file.size() >= 512 && std::memcmp(file.at(0, 8), "ISOBRICK", 8) == 0, "no pyramid");
  require(file.u32(8) >= 3 && file.u32(8) <= 5, "unknown version");
  require(file.u32(12) == 512, "header_bytes");
  file.checkHash(0, 504, file.u64(504), "the header");
  file.cover(504, 8, "the header's checksum");
  p.file_bytes = file.u64(16);
  require(p.file_bytes == file.size(), "file_bytes");
  p.voxel_type = file.u32(24);
  p.filter = file.u32(28);
  p.brick_cells = file.u32(36);
  p.tile_cells = file.u32(40);
  require(p.voxel_type <= 4, "voxel_type");
  require(p.filter <= 1, "filter");
  require(isPowerOfTwo(p.brick_cells) && p.brick_cells >= 4 && p.brick_cells <= 256, "brick_cells");
  require(isPowerOfTwo(p.tile_cells) && p.tile_cells >= 2 && p.tile_cells <= p.brick_cells,
          "tile_cells");
  require(file.u32(44) >= 2 && file.u32(44) <= 8, "kind_count");
  for (std::uint32_t i = 0; i < 8; ++i) {
    const std::uint32_t kind = file.u32(304 + 4 * i);
    if (i >= file.u32(44)) {
      require(kind == 0, "a kind that is not counted");
      continue;
    }
    require(i < 2 ? kind == i : kind > p.kinds.back(), "kinds");
    p.kinds.push_back(kind);
  }
  p.has_curvature = std::find(p.kinds.begin(), p.kinds.end(), 4u) != p.kinds.end();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::uint64_t voxels = file.u64(48 + 8 * axis);
    require(voxels >= 2 && voxels <= 1048576, "dims");
    p.dims[axis] = static_cast<std::int64_t>(voxels);
    p.spacing[axis] = file.f64(72 + 8 * axis);
    p.origin[axis] = file.f64(96 + 8 * axis);
    require(std::isfinite(p.spacing[axis]) && p.spacing[axis] > 0, "spacing");
    require(std::isfinite(p.origin[axis]), "origin");
  }
  for (std::size_t i = 0; i < 9; ++i) {
    p.direction[i] = file.f64(120 + 8 * i);
    require(std::isfinite(p.direction[i]), "direction");
  }
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = 0; b < 3; ++b) {
      double dot = 0;
      for (std::size_t i = 0; i < 3; ++i) dot += p.direction[3 * a + i] * p.direction[3 * b + i];
      require(std::abs(dot - (a == b ? 1 : 0)) < 1e-5, "direction is not orthonormal");
    }
  p.value_min = file.f64(192);
  p.value_max = file.f64(200);
  p.curvature_epsilon = file.f64(208);
  const auto isVoxel = [&](double v) {
    constexpr double kLeast[] = {0, -128, 0, -32768}, kMost[] = {255, 127, 65535, 32767};
    if (p.voxel_type == 4)
      return std::abs(v) <= 3.4028234663852886e38 &&
             v == static_cast<double>(static_cast<float>(v));
    return v >= kLeast[p.voxel_type] && v <= kMost[p.voxel_type] && v == std::floor(v);
  };
  require(isVoxel(p.value_min) && isVoxel(p.value_max) && p.value_min <= p.value_max,
          "value_min, value_max");
  require(std::isfinite(p.curvature_epsilon) && p.curvature_epsilon >= 0, "curvature_epsilon");
  p.noise = file.f64(296);
  require(p.noise >= 0 && p.noise <= 2 * (p.value_max - p.value_min), "noise");
  if (std::find(p.kinds.begin(), p.kinds.end(), 3u) == p.kinds.end())
    for (std::uint64_t i = 336; i < 360; ++i)
      require(file.number(i, 1) == 0, "bins without errors");
  p.length_unit = file.u32(360);
  require(p.length_unit <= 1, "length_unit");
  const bool has_transform = file.u32(8) >= 4;
  if (has_transform) {
    p.value_scale = file.f64(432);
    p.value_offset = file.f64(440);
    require(std::isfinite(p.value_scale) && p.value_scale > 0, "value_scale");
    require(std::isfinite(p.value_offset), "value_offset");
  }
  if (has_transform) p.missing_voxels = file.u64(448);
  require(p.missing_voxels == 0 || p.voxel_type == 4, "missing_voxels");
  p.is_index = file.u32(8) == 5;
  require(!p.is_index || file.u32(456) == 1 || file.u32(456) == 2, "level0_place");
  for (std::uint64_t i = 364; i < 504; ++i)
    require((i >= 368 && i < 392) || (has_transform && i >= 432 && i < 456) ||
                (p.is_index && i >= 456 && i < 460) || file.number(i, 1) == 0,
            "reserved bytes");
  return p;
}

std::int64_t cellsOf(const PlainPyramid& p, int level, std::size_t axis) {
  return ceilOf(p.dims[axis] - 1, std::int64_t{1} << level);
}

std::uint64_t readLevels(FileBytes& file, PlainPyramid& p) {
  const std::int64_t most = std::max({p.dims[0], p.dims[1], p.dims[2]}) - 1;
  int level_count = 1;
  while ((std::int64_t{1} << (level_count - 1)) < most) ++level_count;
  require(file.u32(32) == static_cast<std::uint32_t>(level_count), "level_count");
  p.level_table_offset = file.u64(216);
  file.checkHash(p.level_table_offset, 56 * static_cast<std::uint64_t>(level_count), file.u64(224),
                 "the level table");
  std::uint64_t rows = 0;
  for (int l = 0; l < level_count; ++l) {
    const std::uint64_t at = p.level_table_offset + 56 * static_cast<std::uint64_t>(l);
    PlainLevel level;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      level.samples[axis] = cellsOf(p, l, axis) + 1;
      level.bricks[axis] = ceilOf(cellsOf(p, l, axis), p.brick_cells);
      require(file.u64(at + 8 * axis) == static_cast<std::uint64_t>(level.samples[axis]),
              "samples of a level");
      require(file.u64(at + 24 + 8 * axis) == static_cast<std::uint64_t>(level.bricks[axis]),
              "bricks of a level");
    }
    level.first_brick = file.u64(at + 48);
    require(level.first_brick == rows, "first_brick");
    rows += static_cast<std::uint64_t>(product(level.bricks));
    p.levels.push_back(level);
  }
  require(file.u64(240) == rows, "brick_count");
  return rows;
}

enum class Presence { kNever, kAlways, kMayBe };

PlainPart readPart(FileBytes& file, std::uint64_t at, std::int64_t expected_bytes,
                   Presence presence, bool is_samples, bool may_be_in_source = false) {
  PlainPart part;
  part.offset = file.u64(at);
  part.checksum = file.u64(at + 8);
  part.stored_bytes = file.u32(at + 16);
  part.codec = file.u32(at + 20);
  if (part.codec == 1 || part.codec == 2) {
    require(presence == Presence::kMayBe || (part.codec == 1) == (presence == Presence::kAlways),
            "codec");
    require(part.offset == 0 && part.stored_bytes == 0 && part.checksum == 0, "an empty part");
    return part;
  }
  if (part.codec == 5) {  // section 15
    require(may_be_in_source && part.offset == 0 &&
                static_cast<std::int64_t>(part.stored_bytes) == expected_bytes,
            "a part in the source");
    return part;
  }
  require(part.codec == 0 || part.codec == 3 || part.codec == 4, "unknown codec");
  require(!may_be_in_source, "samples that should be in the source");
  require(presence != Presence::kNever, "a part that should be absent");
  const bool is_stored = part.codec == 0;
  require(is_stored ? static_cast<std::int64_t>(part.stored_bytes) == expected_bytes
                    : part.stored_bytes > 0 && part.stored_bytes < expected_bytes,
          "size of a part");
  require(part.offset % (is_stored && is_samples && expected_bytes >= 4096 ? 4096 : 64) == 0,
          "alignment of a part");
  file.checkHash(part.offset, part.stored_bytes, part.checksum, "a part of a brick");
  return part;
}

// Section 5, "Packed parts": the table of the buffer's first 16 bytes.
void checkBloscHeader(const std::uint8_t* buffer, const PlainPart& part, std::uint64_t bytes) {
  require(part.stored_bytes > 16, "a Blosc buffer without a header");
  require(buffer[0] == 2 && buffer[1] == 1, "version of a Blosc buffer");
  require(buffer[2] >> 5 == (part.codec == 3 ? 1 : 4), "compressor of a Blosc buffer");
  require((buffer[2] & 0x0e) == 0, "flags of a Blosc buffer");
  const std::uint64_t width = buffer[3], block_bytes = numberAt(buffer + 8, 4);
  require(width == 1 || width == 2 || width == 4 || width == 8, "typesize of a Blosc buffer");
  require(numberAt(buffer + 4, 4) == bytes && bytes % width == 0, "nbytes of a Blosc buffer");
  require(block_bytes % width == 0 && block_bytes >= std::min<std::uint64_t>(128, bytes) &&
              block_bytes <= std::min<std::uint64_t>(1 << 20, bytes),
          "blocksize of a Blosc buffer");
  require(numberAt(buffer + 12, 4) == part.stored_bytes, "cbytes of a Blosc buffer");
}

// v(i) of section 5 from e(i), number by number.
void sumUpDifferences(std::vector<std::uint8_t>& elements, int width) {
  std::uint64_t v = 0;
  for (std::size_t at = 0; at < elements.size(); at += static_cast<std::size_t>(width)) {
    const std::uint64_t e = numberAt(elements.data() + at, width);
    v += e % 2 == 0 ? e / 2 : ~(e / 2);  // ~(e/2) is -(e+1)/2 modulo 2^64
    for (int i = 0; i < width; ++i)
      elements[at + static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(v >> (8 * i));
  }
}

// The bytes of a part's elements, where it has any in the file.
std::vector<std::uint8_t> elementsOf(const FileBytes& file, const PlainPart& part,
                                     std::int64_t expected_bytes) {
  const std::uint8_t* stored = file.at(part.offset, part.stored_bytes);
  if (part.codec == 0) return {stored, stored + part.stored_bytes};
  std::vector<std::uint8_t> elements(static_cast<std::size_t>(expected_bytes));
  checkBloscHeader(stored, part, elements.size());
  require(blosc_decompress_ctx(stored, elements.data(), elements.size(), 1) == expected_bytes,
          "a part that cannot be unpacked");
  if (part.codec == 4 && (stored[2] & 1) != 0) sumUpDifferences(elements, stored[3]);
  return elements;
}

bool hasBytes(const PlainPart& part) { return part.stored_bytes > 0 && part.codec != 5; }

void readElements(const FileBytes& file, std::uint32_t voxel_type, float constant, bool has_codes,
                  PlainBrick& brick) {
  const std::int64_t voxel = kVoxelSizes[voxel_type];
  const std::int64_t samples = product(brick.count), tiles = product(brick.tiles);
  const std::int64_t codes = 8 * product(brick.blocks);
  if (brick.parts[0].codec != 5) brick.samples.assign(static_cast<std::size_t>(samples), constant);
  if (hasBytes(brick.parts[0])) {
    const auto elements = elementsOf(file, brick.parts[0], samples * voxel);
    for (std::size_t i = 0; i < brick.samples.size(); ++i)
      brick.samples[i] = voxelAt(&elements[i * static_cast<std::size_t>(voxel)], voxel_type);
  }
  brick.tile_ranges.assign(static_cast<std::size_t>(tiles), {constant, constant});
  if (hasBytes(brick.parts[1])) {
    const auto elements = elementsOf(file, brick.parts[1], tiles * 2 * voxel);
    for (std::size_t i = 0; i < brick.tile_ranges.size(); ++i) {
      const std::uint8_t* pair = &elements[2 * i * static_cast<std::size_t>(voxel)];
      brick.tile_ranges[i] = {voxelAt(pair, voxel_type), voxelAt(pair + voxel, voxel_type)};
    }
  }
  if (!has_codes) return;
  brick.codes.assign(static_cast<std::size_t>(codes), brick.parts[2].codec == 2 ? 255 : 0);
  if (hasBytes(brick.parts[2])) brick.codes = elementsOf(file, brick.parts[2], codes);
}

PlainBrick readBrick(FileBytes& file, const PlainPyramid& p, int level, const PlainIndex& index,
                     std::uint64_t at) {
  PlainBrick brick;
  brick.level = level;
  brick.index = index;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int64_t cells = cellsOf(p, level, axis);
    brick.first_cell[axis] = index[axis] * p.brick_cells;
    brick.cells[axis] = std::min(p.brick_cells, cells - brick.first_cell[axis]);
    const std::int64_t last_cell = brick.first_cell[axis] + brick.cells[axis] - 1;
    brick.first_sample[axis] = std::max<std::int64_t>(brick.first_cell[axis] - 1, 0);
    brick.count[axis] = std::min(last_cell + 2, cells) - brick.first_sample[axis] + 1;
    brick.tiles[axis] = ceilOf(brick.cells[axis], p.tile_cells);
    brick.blocks[axis] = ceilOf(brick.cells[axis], plainBlockCells(p));
  }
  const std::uint32_t voxel = kVoxelSizes[p.voxel_type];
  const std::int64_t bytes[3] = {product(brick.count) * voxel, product(brick.tiles) * 2 * voxel,
                                 product(brick.blocks) * 8};
  brick.parts[2].codec = 2;
  for (const std::uint32_t kind : p.kinds) {
    require(kind < 5, "a kind that this reader does not know");
    const std::size_t part = kind == 4 ? 2 : kind;
    if (kind != 2 && kind != 3)
      brick.parts[part] = readPart(file, at, bytes[part],
                                   part < 2     ? Presence::kAlways
                                   : level == 0 ? Presence::kMayBe
                                                : Presence::kNever,
                                   part == 0, part == 0 && level == 0 && p.is_index);
    else if (file.u32(at + 16) > 0)  // section 9: passed over
      file.checkHash(file.u64(at), file.u32(at + 16), file.u64(at + 8), "a part of an older kind");
    at += 24;
  }
  brick.range = {file.f32(at), file.f32(at + 4)};
  // Section 6: no range, where no voxel has data.
  constexpr float kMost = std::numeric_limits<float>::max();
  const auto isNone = [&](const PlainRange& range) {
    return p.missing_voxels > 0 && range.min == kMost && range.max == -kMost;
  };
  require(brick.range.min <= brick.range.max || isNone(brick.range), "range of a brick");
  const float constant = file.f32(at + 8);

  if (brick.parts[0].codec == 1)
    require((constant >= brick.range.min && constant <= brick.range.max) ||
                (p.missing_voxels > 0 && std::isnan(constant)),
            "constant of a brick");
  else
    require(brick.parts[1].codec != 1, "constant ranges of samples that are not");
  readElements(file, p.voxel_type, constant, p.has_curvature && level == 0, brick);
  for (const PlainRange& range : brick.tile_ranges)
    require(isNone(range) || (range.min <= range.max && range.min >= brick.range.min &&
                              range.max <= brick.range.max),
            "range of a tile");
  return brick;
}

// Section 10: the number of a bin that the voxels of one value share.
std::int64_t binOfValue(double value, std::uint32_t voxel_type) {
  static constexpr std::int64_t kLeast[4] = {0, -128, 0, -32768};
  if (voxel_type < 4) return static_cast<std::int64_t>(value) - kLeast[voxel_type];
  const auto single = static_cast<float>(value == 0 ? 0 : value);
  std::uint32_t bits;
  std::memcpy(&bits, &single, sizeof bits);
  const std::uint32_t upper = bits >> 16;
  return upper < 32768 ? 32768 + upper : 65535 - upper;
}

void readHistogram(FileBytes& file, PlainPyramid& p) {
  const std::int64_t bins =
      binOfValue(p.value_max, p.voxel_type) - binOfValue(p.value_min, p.voxel_type) + 1;
  const PlainPart part = readPart(file, 272, 8 * bins, Presence::kAlways, false);
  const std::vector<std::uint8_t> elements = elementsOf(file, part, 8 * bins);
  std::uint64_t voxels = 0;
  for (std::size_t at = 0; at < elements.size(); at += 8) {
    p.histogram.push_back(numberAt(&elements[at], 8));
    voxels += p.histogram.back();
  }
  require(voxels + p.missing_voxels == static_cast<std::uint64_t>(product(p.dims)),
          "the histogram's voxels");
  require(p.histogram.front() > 0 && p.histogram.back() > 0, "the histogram's ends");
}

// Section 10, "Gradients".
void readGradients(FileBytes& file, PlainPyramid& p) {
  if (file.u64(368) == 0) {
    for (std::uint64_t at = 368; at < 392; at += 8) require(file.u64(at) == 0, "no gradients");
    return;
  }
  const std::int64_t parts = std::clamp<std::int64_t>(product(p.dims) / 64, 16, 256);
  const std::int64_t bytes = 4 * (8 + 6 * parts);
  const std::vector<std::uint8_t> elements =
      elementsOf(file, readPart(file, 368, bytes, Presence::kAlways, false), bytes);
  for (std::size_t at = 0; at < elements.size(); at += 4)
    p.gradients.push_back(voxelAt(&elements[at], 4));
  for (std::size_t i = 0; i < p.gradients.size(); ++i)
    require(std::isfinite(p.gradients[i]) && (i == 0 || p.gradients[i] >= 0), "gradients");
  require(p.gradients[0] + p.gradients[1] > p.gradients[0], "width of the gradients' parts");
}

// Section 1; only writers are held to it.
void requirePartsInOrder(const PlainPyramid& p) {
  std::uint64_t end = 512;
  for (const PlainBrick& brick : p.bricks)
    for (std::size_t kind = 0; kind < 3; ++kind) {
      const PlainPart& part = brick.parts[kind];
      if (!hasBytes(part)) continue;
      require(part.offset >= end, "parts in another order than the brick table");
      end = part.offset + part.stored_bytes;
    }
}

}  // namespace

float PlainBrick::sampleAt(const PlainIndex& sample) const {
  PlainIndex local;
  for (std::size_t axis = 0; axis < 3; ++axis) local[axis] = sample[axis] - first_sample[axis];
  return samples.at(positionIn(local, count));
}

PlainRange PlainBrick::tileRangeOfCell(const PlainIndex& cell, std::int64_t tile_cells) const {
  PlainIndex tile;
  for (std::size_t axis = 0; axis < 3; ++axis)
    tile[axis] = (cell[axis] - first_cell[axis]) / tile_cells;
  return tile_ranges.at(positionIn(tile, tiles));
}

const PlainBrick& PlainPyramid::brickAt(int level, const PlainIndex& index) const {
  const PlainLevel& l = levels.at(static_cast<std::size_t>(level));
  return bricks.at(l.first_brick + positionIn(index, l.bricks));
}

std::vector<std::uint8_t> readWholeFile(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  require(stream.good(), "cannot open " + path);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

PlainPyramid readPlainPyramid(const std::string& path) {
  FileBytes file(path);
  PlainPyramid p = readHeader(file);
  const std::uint64_t rows = readLevels(file, p);
  p.brick_table_offset = file.u64(232);
  const std::uint64_t row_bytes = 24 * p.kinds.size() + 24;
  require(rows <= file.size() / row_bytes, "brick_count");
  for (std::uint64_t row = 0; row < rows; ++row) {
    const std::uint64_t at = p.brick_table_offset + row * row_bytes;
    require(XXH3_64bits_withSeed(file.at(at, row_bytes), row_bytes - 8, row) ==
                file.u64(at + row_bytes - 8),
            "wrong checksum of a row of the brick table");
    file.cover(at, row_bytes, "a row of the brick table");
  }
  p.provenance_offset = file.u64(248);
  const std::uint64_t text_bytes = file.u64(256);
  file.checkHash(p.provenance_offset, text_bytes, file.u64(264), "the provenance");
  readHistogram(file, p);
  readGradients(file, p);
  p.provenance.assign(reinterpret_cast<const char*>(file.at(p.provenance_offset, text_bytes)),
                      text_bytes);
  for (int level = 0; level < static_cast<int>(p.levels.size()); ++level) {
    const PlainIndex count = p.levels[static_cast<std::size_t>(level)].bricks;
    PlainIndex index;
    for (index[2] = 0; index[2] < count[2]; ++index[2])
      for (index[1] = 0; index[1] < count[1]; ++index[1])
        for (index[0] = 0; index[0] < count[0]; ++index[0])
          p.bricks.push_back(
              readBrick(file, p, level, index, p.brick_table_offset + row_bytes * p.bricks.size()));
  }
  requirePartsInOrder(p);
  file.requireZeroPadding();
  p.covered = file.takeCovered();
  return p;
}

double plainDeviationOfCode(std::uint8_t code) {
  if (code == 0) return 0;
  if (code == 255) return std::numeric_limits<double>::infinity();
  return std::ldexp(1 + (code - 1) % 4 / 4.0, (code - 1) / 4 - 10);
}

PlainRange plainBlockRange(const PlainPyramid& p, const PlainBrick& brick,
                           const PlainIndex& block) {
  const std::int64_t edge = plainBlockCells(p) / p.tile_cells;
  PlainRange range;
  bool is_first = true;
  for (std::int64_t z = block[2] * edge; z < std::min((block[2] + 1) * edge, brick.tiles[2]); ++z)
    for (std::int64_t y = block[1] * edge; y < std::min((block[1] + 1) * edge, brick.tiles[1]); ++y)
      for (std::int64_t x = block[0] * edge; x < std::min((block[0] + 1) * edge, brick.tiles[0]);
           ++x) {
        const PlainRange& tile = brick.tile_ranges[static_cast<std::size_t>(
            (z * brick.tiles[1] + y) * brick.tiles[0] + x)];
        range = is_first ? tile
                         : PlainRange{std::min(range.min, tile.min), std::max(range.max, tile.max)};
        is_first = false;
      }
  return range;
}

double plainDeviationBound(const std::uint8_t codes[8], const PlainRange& range, double value) {
  const double r0 = static_cast<double>(range.min), r1 = static_cast<double>(range.max);
  const double at = r1 > r0 ? std::clamp(8 * (value - r0) / (r1 - r0) - 0.5, 0.0, 7.0) : 0.0;
  const int low = static_cast<int>(at);
  double sum = 0;
  for (int j = low; j < std::min(low + 2, 8); ++j) {
    const double weight = 1 - std::abs(at - j);
    if (weight > 0) sum += weight * plainDeviationOfCode(codes[j]);
  }
  return sum;
}

}  // namespace isobrick::test
