// The brick table: the order of its rows, and the entry of a brick, with its possible values. Rows
// from files are hostile; the checks here serve finished pyramids and those that a killed build
// left.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

enum class PartKind { kSamples, kRanges, kCurvature };
inline constexpr std::array kPartKinds = {PartKind::kSamples, PartKind::kRanges,
                                          PartKind::kCurvature};
// "samples", "ranges" or "curvature".
constexpr const char* partName(PartKind kind) {
  constexpr const char* kNames[] = {"samples", "ranges", "curvature"};
  return kNames[static_cast<std::size_t>(kind)];
}

// The kind's number in the file's header; those of others are passed over.
constexpr std::uint32_t kindNumber(PartKind kind) {
  constexpr std::uint32_t kPartNumbers[] = {0, 1, 4};
  return kPartNumbers[static_cast<std::size_t>(kind)];
}

// A row of the brick table, with an entry for every kind that this program reads; parts that the
// file does not have are absent.
struct BrickRow {
  std::array<format::PartEntry, kPartKinds.size()> parts;
  float range_min = 0, range_max = 0;
  float constant = 0;
  std::uint32_t unused = 0;  // journals have no padding

  const format::PartEntry& part(PartKind kind) const {
    return parts[static_cast<std::size_t>(kind)];
  }
  format::PartEntry& part(PartKind kind) { return parts[static_cast<std::size_t>(kind)]; }
};

// True if the bytes of the part lie in the file.
constexpr bool isInFile(const format::PartEntry& part) {
  return part.stored_bytes > 0 &&
         part.codec != static_cast<std::uint32_t>(format::Codec::kInSource);
}

// Bytes of the elements of a part, unpacked, as the layout gives them; `layout` is spec.layout().
std::uint64_t partBytes(const PyramidSpec& spec, const BrickLayout& layout, PartKind kind,
                        int level, const Index3& brick);

// True if codecs, sizes and alignment of all parts, and the constant, are possible for this brick.
// The caller checks the place of the bytes and the range of the brick.
bool isPossibleRow(const BrickRow& row, const PyramidSpec& spec, const BrickLayout& layout,
                   int level, const Index3& brick);

// isPossibleRow() for one part, and for the constant alone.
bool isPossiblePart(const BrickRow& row, const PyramidSpec& spec, const BrickLayout& layout,
                    PartKind kind, int level, const Index3& brick);
bool isPossibleConstant(float constant, const PyramidSpec& spec);

// A box of bricks of each of some levels that follow each other, numbered as their rows are: all of
// the finest level, x fastest, then all of the next one, and so on.
class TableRows {
 public:
  TableRows() = default;
  // All bricks of all levels.
  explicit TableRows(const BrickLayout& layout) {
    for (int level = 0; level < layout.lattice().levels(); ++level)
      add({Index3(0), layout.bricks(level)});
  }
  // `boxes[i]` of level first_level + i.
  TableRows(int first_level, const std::vector<IndexBox>& boxes) : first_level_(first_level) {
    for (const IndexBox& box : boxes) add(box);
  }

  std::size_t count() const { return count_; }
  int firstLevel() const { return first_level_; }
  int endLevel() const { return first_level_ + static_cast<int>(boxes_.size()); }
  // For a level within these.
  const IndexBox& bricks(int level) const { return boxes_[place(level)]; }
  std::size_t firstOfLevel(int level) const { return first_[place(level)]; }
  bool hasLevel(int level) const { return level >= first_level_ && level < endLevel(); }

  // For a brick that is among them.
  std::size_t row(int level, const Index3& brick) const {
    const IndexBox& box = bricks(level);
    return firstOfLevel(level) +
           static_cast<std::size_t>(linearIndex(brick - box.first, box.count));
  }
  // For a row below count().
  BrickAddress address(std::size_t row) const {
    const auto after = std::upper_bound(first_.begin(), first_.end(), row);
    const auto at = static_cast<std::size_t>(after - first_.begin()) - 1;
    const auto n = static_cast<std::int64_t>(row - first_[at]);
    return {first_level_ + static_cast<int>(at), boxes_[at].first + indexAt(n, boxes_[at].count)};
  }

 private:
  std::size_t place(int level) const { return static_cast<std::size_t>(level - first_level_); }
  void add(const IndexBox& box) {
    boxes_.push_back(box);
    first_.push_back(count_);
    // kMaxVoxelsPerAxis bounds the count by 2^57.
    count_ += static_cast<std::size_t>(box.size());
  }

  int first_level_ = 0;
  std::vector<IndexBox> boxes_;     // for each level
  std::vector<std::size_t> first_;  // likewise
  std::size_t count_ = 0;
};

}  // namespace isobrick
