// The bricks of a brick table and their rows.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

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
