// A set of cells in a box.
#pragma once

#include <algorithm>
#include <cstdint>
#include <glm/common.hpp>
#include <vector>

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// A bit for each cell of a box, in rows of words along x.
class CellBits {
 public:
  CellBits() = default;
  // No cell of the box.
  explicit CellBits(const IndexBox& box)
      : box_(box),
        words_(wordsOf(box.count.x)),
        bits_(static_cast<std::size_t>(words_ * box.count.y * box.count.z)) {}

  const IndexBox& box() const { return box_; }
  std::int64_t words() const { return words_; }  // a row
  // Cell (box().first.x + i, y, z) in bit i % 64 of word i / 64.
  std::uint64_t* row(std::int64_t y, std::int64_t z) { return bits_.data() + offset(y, z); }
  const std::uint64_t* row(std::int64_t y, std::int64_t z) const {
    return bits_.data() + offset(y, z);
  }
  // Cells of the box.
  bool has(const Index3& cell) const {
    const std::int64_t i = cell.x - box_.first.x;
    return (row(cell.y, cell.z)[i / 64] >> i % 64 & 1) != 0;
  }
  void add(const Index3& cell) {
    const std::int64_t i = cell.x - box_.first.x;
    row(cell.y, cell.z)[i / 64] |= std::uint64_t{1} << i % 64;
  }
  // Those of others that lie in the box.
  void add(const CellBits& others) {
    const Index3 first = glm::max(others.box().first, box_.first);
    const Index3 end = glm::min(others.box().end(), box_.end());
    if (first.x >= end.x) return;
    for (std::int64_t z = first.z; z < end.z; ++z)
      for (std::int64_t y = first.y; y < end.y; ++y)
        addBits(others.row(y, z), first.x - others.box().first.x, row(y, z), first.x - box_.first.x,
                end.x - first.x);
  }

 private:
  std::int64_t offset(std::int64_t y, std::int64_t z) const {
    return ((z - box_.first.z) * box_.count.y + y - box_.first.y) * words_;
  }

  IndexBox box_;
  std::int64_t words_ = 0;
  std::vector<std::uint64_t> bits_;
};

}  // namespace isobrick
