#include "tests/support/sealed_pyramid.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick::test {
namespace {

template <typename T>
T get(const Bytes& file, std::uint64_t at) {
  T value;
  std::memcpy(&value, file.data() + at, sizeof value);
  return value;
}
template <typename T>
void put(Bytes& file, std::uint64_t at, const T& value) {
  std::memcpy(file.data() + at, &value, sizeof value);
}

// The hash of what lies there, or of what of it lies in the file.
std::uint64_t hashOf(const Bytes& file, std::uint64_t offset, std::uint64_t bytes) {
  if (offset >= file.size()) return 0;
  return checksum64(file.data() + offset, std::min<std::uint64_t>(bytes, file.size() - offset));
}

PyramidSpec specOf(const format::Header& header) {
  PyramidSpec spec;
  for (int axis = 0; axis < 3; ++axis)
    spec.voxels[axis] = static_cast<std::int64_t>(header.dims[axis]);
  spec.voxel_type = static_cast<VoxelType>(header.voxel_type);
  spec.brick_cells = header.brick_cells;
  spec.tile_cells = header.tile_cells;
  spec.has_curvature = header.kind_count > 2 && header.kinds[2] == kindNumber(PartKind::kCurvature);
  return spec;
}

std::uint64_t rowBytesOf(const format::Header& header) {
  return format::rowBytes(std::min(header.kind_count, format::kMostKinds));
}

BrickRow rowAt(const Bytes& file, const format::Header& header, std::uint64_t at) {
  BrickRow row;
  row.parts.fill({0, 0, 0, static_cast<std::uint32_t>(format::Codec::kAbsent)});
  for (std::uint32_t i = 0; i < header.kind_count; ++i)
    for (const PartKind kind : kPartKinds)
      if (header.kinds[i] == kindNumber(kind))
        row.part(kind) = get<format::PartEntry>(file, at + i * sizeof(format::PartEntry));
  const auto tail = get<format::RowTail>(file, at + rowBytesOf(header) - sizeof(format::RowTail));
  row.range_min = tail.range_min;
  row.range_max = tail.range_max;
  row.constant = tail.constant;
  row.unused = tail.error_bytes;
  return row;
}

// Without checksums.
Bytes bytesOf(const BrickRow& row, const format::Header& header) {
  Bytes bytes(rowBytesOf(header));
  const std::uint32_t kinds = std::min(header.kind_count, format::kMostKinds);
  for (std::uint32_t i = 0; i < kinds; ++i) {
    format::PartEntry entry{0, 0, 0, static_cast<std::uint32_t>(format::Codec::kAbsent)};
    for (const PartKind kind : kPartKinds)
      if (header.kinds[i] == kindNumber(kind)) entry = row.part(kind);
    put(bytes, i * sizeof(format::PartEntry), entry);
  }
  put(bytes, bytes.size() - sizeof(format::RowTail),
      format::RowTail{row.range_min, row.range_max, row.constant, row.unused, 0});
  return bytes;
}

}  // namespace

PyramidDraft::PyramidDraft(const Bytes& file) {
  header = get<format::Header>(file, 0);
  spec_ = specOf(header);
  layout_ = spec_.layout();
  std::uint64_t row = 0;
  for (std::uint32_t level = 0; level < header.level_count; ++level) {
    levels.push_back(
        get<format::LevelRow>(file, header.level_table_offset + level * sizeof(format::LevelRow)));
    const Index3 count = layout_.bricks(static_cast<int>(level));
    for (std::int64_t i = 0; i < elementCount(count); ++i, ++row) {
      Brick brick;
      brick.level = static_cast<int>(level);
      brick.index = indexAt(i, count);
      brick.row = rowAt(file, header, header.brick_table_offset + row * rowBytesOf(header));
      for (const PartKind kind : kPartKinds) {
        const format::PartEntry& part = brick.row.part(kind);
        const auto first = file.begin() + static_cast<std::ptrdiff_t>(part.offset);
        brick.stored[static_cast<std::size_t>(kind)].assign(first, first + part.stored_bytes);
      }
      bricks.push_back(std::move(brick));
    }
  }
  const auto counts = file.begin() + static_cast<std::ptrdiff_t>(header.histogram.offset);
  histogram.assign(counts, counts + header.histogram.stored_bytes);
  const auto steepness = file.begin() + static_cast<std::ptrdiff_t>(header.gradients.offset);
  gradients.assign(steepness, steepness + header.gradients.stored_bytes);
  provenance.assign(reinterpret_cast<const char*>(file.data()) + header.provenance_offset,
                    header.provenance_bytes);
}

PyramidDraft::Elements PyramidDraft::elementsOf(const Brick& brick) const {
  Elements elements;
  for (const PartKind kind : kPartKinds) {
    const format::PartEntry& part = brick.row.part(kind);
    const auto codec = static_cast<format::Codec>(part.codec);
    auto& out = elements[static_cast<std::size_t>(kind)];
    if (codec == format::Codec::kAbsent) continue;
    out.resize(partBytes(spec_, layout_, kind, brick.level, brick.index));
    if (codec == format::Codec::kConstant) {
      if (kind == PartKind::kCurvature) continue;
      visitVoxelType(spec_.voxel_type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        const T value = static_cast<T>(brick.row.constant);
        for (std::size_t at = 0; at < out.size(); at += sizeof value)
          std::memcpy(out.data() + at, &value, sizeof value);
      });
      continue;
    }
    const Bytes& stored = brick.stored[static_cast<std::size_t>(kind)];
    if (!decodePart(codec, {reinterpret_cast<const std::byte*>(stored.data()), stored.size()},
                    out.size(), out.data()))
      throw std::runtime_error("a part of a good pyramid cannot be unpacked");
  }
  return elements;
}

void PyramidDraft::setElements(Brick& brick, const Elements& elements, format::Codec codec) const {
  EncodedBrick encoded;
  encoded.samples.bytes = elements[0];
  encoded.ranges.bytes = elements[1];
  encoded.curvature.bytes = elements[2];
  encodeBrick(spec_.voxel_type, codec, encoded);
  brick.row.constant = encoded.constant;
  const EncodedPart* const parts[] = {&encoded.samples, &encoded.ranges, &encoded.curvature};
  for (const PartKind kind : kPartKinds) {
    const auto at = static_cast<std::size_t>(kind);
    const auto* const first = reinterpret_cast<const std::uint8_t*>(parts[at]->bytes.data());
    brick.stored[at].assign(first, first + parts[at]->bytes.size());
    brick.row.part(kind).codec = static_cast<std::uint32_t>(parts[at]->codec);
    brick.row.part(kind).stored_bytes = static_cast<std::uint32_t>(brick.stored[at].size());
  }
}

Bytes PyramidDraft::seal() const {
  Bytes file(sizeof header);
  const auto append = [&](const void* data, std::size_t bytes) {
    file.resize((file.size() + format::kPartAlignment - 1) / format::kPartAlignment *
                format::kPartAlignment);
    const std::uint64_t offset = file.size();
    const auto* const from = static_cast<const std::uint8_t*>(data);
    file.insert(file.end(), from, from + bytes);
    return offset;
  };
  std::vector<BrickRow> rows;
  for (const Brick& brick : bricks) {
    rows.push_back(brick.row);
    for (const PartKind kind : kPartKinds) {
      const Bytes& stored = brick.stored[static_cast<std::size_t>(kind)];
      format::PartEntry& part = rows.back().part(kind);
      part.offset = stored.empty() ? 0 : append(stored.data(), stored.size());
      part.checksum = 0;
    }
  }
  format::Header sealed = header;
  sealed.histogram.offset = append(histogram.data(), histogram.size());
  sealed.histogram.stored_bytes = static_cast<std::uint32_t>(histogram.size());
  if (!gradients.empty()) sealed.gradients.offset = append(gradients.data(), gradients.size());
  sealed.gradients.stored_bytes = static_cast<std::uint32_t>(gradients.size());
  sealed.level_table_offset = append(levels.data(), levels.size() * sizeof(format::LevelRow));
  Bytes table;
  for (const BrickRow& row : rows) {
    const Bytes bytes = bytesOf(row, header);
    table.insert(table.end(), bytes.begin(), bytes.end());
  }
  sealed.brick_table_offset = append(table.data(), table.size());
  sealed.brick_count = rows.size();
  sealed.provenance_offset = append(provenance.data(), provenance.size());
  sealed.provenance_bytes = provenance.size();
  sealed.file_bytes = file.size();
  put(file, 0, sealed);
  sealChecksums(file);
  return file;
}

void sealChecksums(Bytes& file) {
  if (file.size() < sizeof(format::Header)) return;
  auto header = get<format::Header>(file, 0);
  const std::uint64_t room =
      header.brick_table_offset < file.size() ? (file.size() - header.brick_table_offset) : 0;
  const std::uint64_t row_bytes = rowBytesOf(header);
  const std::uint64_t rows = std::min<std::uint64_t>(header.brick_count, room / row_bytes);
  for (std::uint64_t i = 0; i < rows; ++i) {
    const std::uint64_t begin = header.brick_table_offset + i * row_bytes;
    const std::uint64_t end = begin + row_bytes - sizeof(format::RowTail);
    for (std::uint64_t at = begin; at < end; at += sizeof(format::PartEntry)) {
      auto part = get<format::PartEntry>(file, at);
      if (part.stored_bytes > 0) part.checksum = hashOf(file, part.offset, part.stored_bytes);
      put(file, at, part);
    }
    const std::uint64_t hash = begin + row_bytes - sizeof(std::uint64_t);
    put(file, hash, checksum64(file.data() + begin, hash - begin, i));
  }
  if (header.histogram.stored_bytes > 0)
    header.histogram.checksum =
        hashOf(file, header.histogram.offset, header.histogram.stored_bytes);
  if (header.gradients.stored_bytes > 0)
    header.gradients.checksum =
        hashOf(file, header.gradients.offset, header.gradients.stored_bytes);
  header.level_table_checksum =
      hashOf(file, header.level_table_offset,
             std::uint64_t{header.level_count} * sizeof(format::LevelRow));
  header.provenance_checksum = hashOf(file, header.provenance_offset, header.provenance_bytes);
  header.header_checksum = checksum64(&header, offsetof(format::Header, header_checksum));
  put(file, 0, header);
}

}  // namespace isobrick::test
