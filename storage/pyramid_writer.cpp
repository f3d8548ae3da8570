#include "storage/pyramid_writer.h"

#include <array>
#include <cassert>
#include <cstring>

#include "storage/checksum.h"

namespace isobrick {
namespace {

EncodedPart storedPart(const void* data, std::size_t bytes) {
  EncodedPart part;
  part.codec = format::Codec::kStored;
  part.bytes.resize(bytes);
  std::memcpy(part.bytes.data(), data, bytes);
  part.checksum = checksum64(data, bytes);
  return part;
}

EncodedPart emptyPart(format::Codec codec) {
  EncodedPart part;
  part.codec = codec;
  return part;
}

// True where all elements of `element_bytes` bytes are the same.
bool allEqual(std::span<const std::byte> data, std::size_t element_bytes) {
  return data.size() <= element_bytes ||
         std::memcmp(data.data(), data.data() + element_bytes, data.size() - element_bytes) == 0;
}

// True where every tile's range is that of the brick, which may be wider: it covers the samples of
// more levels.
bool allTilesHaveRange(VoxelType type, std::span<const std::byte> ranges, const ValueRange& range) {
  return visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    const T pair[2] = {static_cast<T>(range.min), static_cast<T>(range.max)};
    return std::memcmp(ranges.data(), pair, sizeof pair) == 0 && allEqual(ranges, sizeof pair);
  });
}

}  // namespace

EncodedBrick encodeBrick(VoxelType type, std::span<const std::byte> samples,
                         std::span<const std::byte> ranges, std::span<const std::uint8_t> curvature,
                         const ValueRange& range) {
  EncodedBrick brick;
  brick.range = range;
  if (allEqual(samples, voxelBytes(type))) {
    brick.samples = emptyPart(format::Codec::kConstant);
    brick.constant = visitVoxelType(type, [&](auto tag) {
      typename decltype(tag)::Type value;
      std::memcpy(&value, samples.data(), sizeof value);
      return static_cast<float>(value);
    });
  } else {
    brick.samples = storedPart(samples.data(), samples.size());
  }
  brick.ranges = allTilesHaveRange(type, ranges, range) ? emptyPart(format::Codec::kConstant)
                                                        : storedPart(ranges.data(), ranges.size());
  if (!curvature.empty()) {
    const auto coefficients = std::as_bytes(curvature);
    brick.curvature = coefficients[0] == std::byte{0} && allEqual(coefficients, 1)
                          ? emptyPart(format::Codec::kConstant)
                          : storedPart(coefficients.data(), coefficients.size());
  }
  return brick;
}

PyramidWriter::PyramidWriter(const std::string& path, const PyramidSpec& spec)
    : spec_(spec), layout_(spec.layout()), file_(path) {
  std::uint64_t first_brick = 0;
  for (int level = 0; level < layout_.lattice().levels(); ++level) {
    const Index3 samples = layout_.lattice().samples(level);
    const Index3 bricks = layout_.bricks(level);
    format::LevelRecord record = {};
    for (int axis = 0; axis < 3; ++axis) {
      record.samples[axis] = static_cast<std::uint64_t>(samples[axis]);
      record.bricks[axis] = static_cast<std::uint64_t>(bricks[axis]);
    }
    record.first_brick = first_brick;
    level_table_.push_back(record);
    first_brick += static_cast<std::uint64_t>(elementCount(bricks));
  }
  brick_table_.resize(first_brick);
  // The header is written last; until then its place holds zeros, which no reader takes for one.
  const std::array<std::byte, sizeof(format::Header)> blank{};
  file_.write(blank.data(), blank.size());
  end_ = blank.size();
}

void PyramidWriter::padTo(std::uint64_t alignment) {
  static constexpr std::array<std::byte, format::kSampleAlignment> kZeros{};
  const std::uint64_t rest = (alignment - end_ % alignment) % alignment;
  file_.write(kZeros.data(), rest);
  end_ += rest;
}

format::PartRecord PyramidWriter::append(const EncodedPart& part, std::uint64_t alignment) {
  format::PartRecord record = {};
  record.codec = static_cast<std::uint32_t>(part.codec);
  if (part.bytes.empty()) return record;
  padTo(alignment);
  record.offset = end_;
  record.checksum = part.checksum;
  record.stored_bytes = static_cast<std::uint32_t>(part.bytes.size());
  file_.write(part.bytes.data(), part.bytes.size());
  end_ += part.bytes.size();
  return record;
}

void PyramidWriter::write(int level, const Index3& brick, const EncodedBrick& encoded) {
  const auto row = level_table_[static_cast<std::size_t>(level)].first_brick +
                   static_cast<std::uint64_t>(linearIndex(brick, layout_.bricks(level)));
  format::BrickRecord& record = brick_table_[row];
  // Only bricks of some size are worth a page of their own.
  const std::uint64_t alignment = encoded.samples.bytes.size() >= format::kSampleAlignment
                                      ? format::kSampleAlignment
                                      : format::kPartAlignment;
  record.samples = append(encoded.samples, alignment);
  record.ranges = append(encoded.ranges, format::kPartAlignment);
  record.curvature = append(encoded.curvature, format::kPartAlignment);
  record.range_min = encoded.range.min;
  record.range_max = encoded.range.max;
  record.constant = encoded.constant;
  ++bricks_written_;
}

std::uint64_t PyramidWriter::finish(const ValueRange& voxel_range,
                                    const std::string& provenance_json) {
  assert(bricks_written_ == brick_table_.size());
  format::Header header = {};
  std::memcpy(header.magic, format::kMagic, sizeof header.magic);
  header.version = format::kVersion;
  header.header_bytes = sizeof header;
  header.voxel_type = static_cast<std::uint32_t>(spec_.voxel_type);
  header.filter = static_cast<std::uint32_t>(spec_.filter);
  header.level_count = static_cast<std::uint32_t>(level_table_.size());
  header.brick_cells = static_cast<std::uint32_t>(spec_.brick_cells);
  header.tile_cells = static_cast<std::uint32_t>(spec_.tile_cells);
  header.has_curvature = spec_.has_curvature ? 1 : 0;
  for (int axis = 0; axis < 3; ++axis) {
    header.dims[axis] = static_cast<std::uint64_t>(spec_.voxels[axis]);
    header.spacing[axis] = spec_.geometry.spacing[axis];
    header.origin[axis] = spec_.geometry.origin[axis];
    for (int row = 0; row < 3; ++row)
      header.direction[3 * axis + row] = spec_.geometry.direction[axis][row];
  }
  header.value_min = static_cast<double>(voxel_range.min);
  header.value_max = static_cast<double>(voxel_range.max);
  header.curvature_epsilon = spec_.curvature_epsilon;

  const auto appendTable = [&](const void* data, std::size_t bytes, std::uint64_t* offset,
                               std::uint64_t* checksum) {
    padTo(format::kPartAlignment);
    *offset = end_;
    *checksum = checksum64(data, bytes);
    file_.write(data, bytes);
    end_ += bytes;
  };
  appendTable(level_table_.data(), level_table_.size() * sizeof(format::LevelRecord),
              &header.level_table_offset, &header.level_table_checksum);
  appendTable(brick_table_.data(), brick_table_.size() * sizeof(format::BrickRecord),
              &header.brick_table_offset, &header.brick_table_checksum);
  appendTable(provenance_json.data(), provenance_json.size(), &header.provenance_offset,
              &header.provenance_checksum);
  header.brick_count = brick_table_.size();
  header.provenance_bytes = provenance_json.size();
  header.file_bytes = end_;
  header.header_checksum = checksum64(&header, offsetof(format::Header, header_checksum));
  file_.pwrite(&header, sizeof header, 0);
  file_.commit();
  return end_;
}

}  // namespace isobrick
