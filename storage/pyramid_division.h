// The files of a divided pyramid, as its index lists them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "isobrick/storage/format.h"
#include "isobrick/storage/super_bricks.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// The closure of a brick of a super-brick: in place of that in row `row` of its file.
struct RangeCorrection {
  std::uint32_t row = 0;
  float min = 0, max = 0;
};

// All files together have one range of offsets: the index's own bytes come first, and then the file
// of each super-brick, at a multiple of format::kSampleAlignment.
class PyramidDivision {
 public:
  // The bytes of Header::division in the index.
  static std::uint64_t tableBytes(const BrickLayout& layout, const SuperBricks& super_bricks) {
    return super_bricks.count() * sizeof(format::FileEntry) +
           static_cast<std::uint64_t>(elementCount(borderBricks(layout, super_bricks))) *
               sizeof(format::Range);
  }
  static std::vector<std::byte> table(std::span<const format::FileEntry> files,
                                      std::span<const ValueRange> ranges);

  // From a table of tableBytes() bytes, of which `next` brings some more: an entry is checked
  // before there is memory for another. `row_bytes` and `index_bytes` are those of the index. None
  // if an entry is impossible: then the table is damaged.
  using NextBytes = std::function<void(std::span<std::byte> out)>;
  static std::optional<PyramidDivision> of(const BrickLayout& layout,
                                           const SuperBricks& super_bricks, const NextBytes& next,
                                           std::uint64_t row_bytes, std::uint64_t index_bytes);

  const SuperBricks& superBricks() const { return super_bricks_; }
  std::size_t fileCount() const { return files_.size(); }
  const format::FileEntry& file(std::size_t number) const { return files_[number]; }
  // Offset at which its bytes begin among those of all.
  std::uint64_t base(std::size_t number) const { return bases_[number]; }
  std::uint64_t indexBytes() const { return index_bytes_; }
  // The end of the last file, and the bytes of all without those between them.
  std::uint64_t endOffset() const { return end_; }
  std::uint64_t fileBytes() const;
  // The file with this offset, which is below endOffset(); nothing: it is the index.
  std::optional<std::size_t> fileAt(std::uint64_t offset) const;

  // The closure of a brick of level superBricks().levels() - 1.
  ValueRange borderRange(const Index3& brick) const {
    return ranges_[static_cast<std::size_t>(linearIndex(brick, border_bricks_))];
  }

 private:
  PyramidDivision(const BrickLayout& layout, const SuperBricks& super_bricks)
      : super_bricks_(super_bricks), border_bricks_(borderBricks(layout, super_bricks)) {}
  static Index3 borderBricks(const BrickLayout& layout, const SuperBricks& super_bricks) {
    return layout.bricks(super_bricks.levels() - 1);
  }

  SuperBricks super_bricks_;
  Index3 border_bricks_;
  std::uint64_t index_bytes_ = 0, end_ = 0;
  std::vector<format::FileEntry> files_;
  std::vector<std::uint64_t> bases_;
  std::vector<ValueRange> ranges_;
};

}  // namespace isobrick
