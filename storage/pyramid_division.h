// How a pyramid is divided into several files, and these as its index lists them.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// A super-brick is a cube of cells of level 0 with the bricks in it of levels 0 .. levels() - 1,
// which lie in a file of its own. The coarser levels lie in the index. Pure arithmetic.
class SuperBricks {
 public:
  // The most levels of a file. Its bricks are made from samples around the super-brick, which reach
  // twice as far with every level: 31 voxels with tiles of 4 cells, which are 9 % more to read
  // around 2048 cells.
  static constexpr int kMostLevels = 4;
  // Along an edge: bounds what is kept for each file in memory.
  static constexpr std::int64_t kMostBricksAlong = 64;

  // `cells` along an edge: a power of two, those of 1 to kMostBricksAlong bricks. The pyramid has
  // two levels or more.
  SuperBricks(const BrickLayout& layout, std::int64_t cells)
      : layout_(layout),
        cells_(cells),
        levels_(std::min({std::countr_zero(static_cast<std::uint64_t>(cells)) -
                              std::countr_zero(static_cast<std::uint64_t>(layout.brickCells())) + 1,
                          kMostLevels, layout.lattice().levels() - 1})) {}

  std::int64_t cells() const { return cells_; }
  int levels() const { return levels_; }
  // Per axis.
  Index3 dims() const { return BrickLayout::ceilDivide(layout_.lattice().cells(0), cells_); }
  std::size_t count() const { return static_cast<std::size_t>(elementCount(dims())); }

  // The bricks of a super-brick, of a level below levels().
  IndexBox bricks(const Index3& super_brick, int level) const {
    const std::int64_t along = bricksAlong(level);
    const Index3 first = super_brick * along;
    return {first, glm::min(Index3(along), layout_.bricks(level) - first)};
  }
  // The place of the super-brick that has the brick, in the order of their numbers, x fastest.
  std::size_t numberOf(int level, const Index3& brick) const {
    return static_cast<std::size_t>(linearIndex(brick / bricksAlong(level), dims()));
  }
  Index3 at(std::size_t number) const { return indexAt(static_cast<std::int64_t>(number), dims()); }

  // The row of a brick, of a level below levels(), in its super-brick's file: as rowsOf() has it.
  std::size_t rowOf(int level, const Index3& brick) const {
    const Index3 place = brick / bricksAlong(level);
    std::int64_t row = 0;
    for (int finer = 0; finer < level; ++finer) row += bricks(place, finer).size();
    const IndexBox box = bricks(place, level);
    return static_cast<std::size_t>(row + linearIndex(brick - box.first, box.count));
  }
  std::size_t rowCount(std::size_t number) const {
    std::int64_t rows = 0;
    for (int level = 0; level < levels_; ++level) rows += bricks(at(number), level).size();
    return static_cast<std::size_t>(rows);
  }
  // The rows of the brick tables.
  TableRows rowsOf(std::size_t number) const {
    std::vector<IndexBox> boxes;
    for (int level = 0; level < levels_; ++level) boxes.push_back(bricks(at(number), level));
    return {0, boxes};
  }
  TableRows rowsOfIndex() const {
    std::vector<IndexBox> boxes;
    for (int level = levels_; level < layout_.lattice().levels(); ++level)
      boxes.push_back({Index3(0), layout_.bricks(level)});
    return {levels_, boxes};
  }

  // "0-2-1.isb": the file's name in the folder of the index.
  std::string fileName(std::size_t number) const {
    const Index3 place = at(number);
    return std::to_string(place.x) + "-" + std::to_string(place.y) + "-" + std::to_string(place.z) +
           ".isb";
  }

 private:
  std::int64_t bricksAlong(int level) const { return (cells_ >> level) / layout_.brickCells(); }

  BrickLayout layout_;
  std::int64_t cells_;
  int levels_;
};

// The name of the index in the folder of a divided pyramid, and the ending of the folder.
inline constexpr char kIndexName[] = "index.isb";
inline constexpr char kDividedEnding[] = ".isbs";

// A file of a divided pyramid.
struct DividedFile {
  SuperBricks super_bricks;
  std::optional<std::size_t> number;  // of its super-brick; nothing: it is the index

  // The bricks of its brick table.
  TableRows rows() const {
    return number ? super_bricks.rowsOf(*number) : super_bricks.rowsOfIndex();
  }
  // Its name in the folder.
  std::string name() const { return number ? super_bricks.fileName(*number) : kIndexName; }
};

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
