#include "isobrick/storage/pyramid_division.h"

#include <algorithm>
#include <cmath>

namespace isobrick {
namespace {

// Bounds of one file and of all: far more than any disk has, and 2^20 times the first is no
// overflow.
constexpr std::uint64_t kMostSuperBrickBytes = std::uint64_t{1} << 52;
constexpr std::uint64_t kMostPyramidBytes = std::uint64_t{1} << 62;

std::uint64_t alignedUp(std::uint64_t offset) {
  constexpr std::uint64_t kAlignment = format::kSampleAlignment;
  return (offset + kAlignment - 1) / kAlignment * kAlignment;
}

bool lies(std::uint64_t offset, std::uint64_t bytes, std::uint64_t end) {
  return offset <= end && bytes <= end - offset;
}

}  // namespace

std::vector<std::byte> PyramidDivision::table(std::span<const format::FileEntry> files,
                                              std::span<const ValueRange> ranges) {
  std::vector<std::byte> bytes;
  const auto append = [&](const void* data, std::size_t size) {
    const auto* const from = static_cast<const std::byte*>(data);
    bytes.insert(bytes.end(), from, from + size);
  };
  append(files.data(), files.size_bytes());
  for (const ValueRange& range : ranges) {
    const format::Range stored{range.min, range.max};
    append(&stored, sizeof stored);
  }
  return bytes;
}

std::optional<PyramidDivision> PyramidDivision::of(const BrickLayout& layout,
                                                   const SuperBricks& super_bricks,
                                                   const NextBytes& next, std::uint64_t row_bytes,
                                                   std::uint64_t index_bytes) {
  PyramidDivision division(layout, super_bricks);
  division.index_bytes_ = index_bytes;
  division.end_ = index_bytes;
  for (std::size_t number = 0; number < super_bricks.count(); ++number) {
    format::FileEntry file;
    next(std::as_writable_bytes(std::span(&file, 1)));
    const std::uint64_t rows = super_bricks.rowCount(number);
    if (file.file_bytes < sizeof(format::Header) || file.file_bytes > kMostSuperBrickBytes ||
        !lies(file.brick_table_offset, rows * row_bytes, file.file_bytes) ||
        !lies(file.corrections.offset, file.corrections.stored_bytes, index_bytes) ||
        file.correction_count > rows ||
        file.corrections.stored_bytes > file.correction_count * sizeof(RangeCorrection))
      return std::nullopt;
    division.bases_.push_back(alignedUp(division.end_));
    division.end_ = division.bases_.back() + file.file_bytes;
    if (division.end_ > kMostPyramidBytes) return std::nullopt;
    division.files_.push_back(file);
  }
  for (std::int64_t brick = 0; brick < elementCount(division.border_bricks_); ++brick) {
    format::Range range;
    next(std::as_writable_bytes(std::span(&range, 1)));
    if (!(range.min <= range.max) || !std::isfinite(range.min) || !std::isfinite(range.max))
      return std::nullopt;
    division.ranges_.push_back({range.min, range.max});
  }
  return division;
}

std::uint64_t PyramidDivision::fileBytes() const {
  std::uint64_t bytes = index_bytes_;
  for (const format::FileEntry& file : files_) bytes += file.file_bytes;
  return bytes;
}

std::optional<std::size_t> PyramidDivision::fileAt(std::uint64_t offset) const {
  const auto after = std::upper_bound(bases_.begin(), bases_.end(), offset);
  if (after == bases_.begin()) return std::nullopt;
  return static_cast<std::size_t>(after - bases_.begin()) - 1;
}

}  // namespace isobrick
