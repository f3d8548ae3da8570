#include "isobrick/extract/oracles/error_oracle.h"

#include <algorithm>
#include <cmath>

#include "isobrick/extract/oracles/cells_beyond.h"
#include "isobrick/extract/oracles/error_cells.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

// What single precision may add to an error: each is made of a few operations on values of this
// size.
float roundingOf(const ValueRange& values, float isovalue) {
  return 0x1p-20f * std::max({std::abs(values.min), std::abs(values.max), std::abs(isovalue)});
}

}  // namespace

ErrorOracle::ErrorOracle(const Pyramid& pyramid, double tolerance, float isovalue)
    : tolerance_(static_cast<float>(tolerance) - roundingOf(pyramid.valueRange(), isovalue)),
      isovalue_(isovalue),
      last_level_(std::min(std::max(1, pyramid.parts().tables().errorBins().last_level),
                           pyramid.lattice().levels() - 1)),
      greatest_code_(pyramid.parts().tables().errorBins().count == 0
                         ? -1
                         : ErrorCode::greatestWithin(
                               tolerance / pyramid.parts().tables().errorBins().unit())) {}
ErrorOracle::~ErrorOracle() = default;

template <typename Value>
template <typename Make>
std::shared_ptr<const Value> ErrorOracle::Shelf<Value>::get(std::size_t row, const Make& make) {
  std::unique_lock lock(mutex_);
  while (true) {
    if (const auto known = values_.find(row); known != values_.end()) return known->second;
    if (in_making_.insert(row).second) break;
    made_.wait(lock);
  }
  lock.unlock();
  std::shared_ptr<const Value> value;
  try {
    value = std::make_shared<const Value>(make());
  } catch (...) {
    lock.lock();
    in_making_.erase(row);
    made_.notify_all();
    throw;
  }
  lock.lock();
  in_making_.erase(row);
  made_.notify_all();
  values_.emplace(row, value);
  order_.push_back(row);
  if (order_.size() > kMostBricks) {
    values_.erase(order_.front());
    order_.pop_front();
  }
  return value;
}

template <typename Value>
bool ErrorOracle::Shelf<Value>::isInMaking(std::size_t row) const {
  const std::lock_guard lock(mutex_);
  return in_making_.count(row) != 0;
}

// Which cells of a level are refined, for who asks for many that are near each other: only for
// those of another brick than before the shelf is asked.
class ErrorOracle::NearCells {
 public:
  NearCells(const ErrorOracle& oracle, const MeshContext& context, int level)
      : oracle_(oracle), context_(context), level_(level) {}

  bool isRefined(const Index3& cell) {
    const Index3 brick = oracle_.brickOf(context_, level_, cell);
    if (!bits_ || brick != brick_) bits_ = oracle_.decided(context_, level_, brick);
    brick_ = brick;
    return bits_->has(cell);
  }

 private:
  const ErrorOracle& oracle_;
  const MeshContext& context_;
  const int level_;
  Bits bits_;
  Index3 brick_{0};
};

ErrorOracle::Found ErrorOracle::foundIn(const MeshContext& context, const Index3& brick) const {
  return found_.get(context.pyramid.parts().brickRow(0, brick), [&] {
    thread_local ErrorCells cells;
    NearCells coarse(*this, context, 2);
    return cells.find(context, brick, {isovalue_, tolerance_}, [&](const Index3& cell) {
      return last_level_ < 2 || coarse.isRefined(cell);
    });
  });
}

Index3 ErrorOracle::brickOf(const MeshContext& context, int level, const Index3& cell) const {
  return (level == 1 ? std::int64_t{2} * cell : cell) / context.pyramid.layout().brickCells();
}

IndexBox ErrorOracle::cellsOf(const MeshContext& context, int level, const Index3& brick) const {
  const BrickLayout& layout = context.pyramid.layout();
  return level == 1 ? coarseCellsOf(layout, brick) : layout.brickCellBox(level, brick);
}

ErrorOracle::Bits ErrorOracle::decided(const MeshContext& context, int level,
                                       const Index3& brick) const {
  const std::size_t row = context.pyramid.parts().brickRow(brickLevel(level), brick);
  return decided_[level].get(row, [&] {
    CellBits cells =
        level == 1 ? beyondAtLevel1(context, brick) : beyondBounds(context, level, brick);
    if (level < last_level_) keepBalanced(context, level, cells);
    return cells;
  });
}

// Whether any of these cells of level 1 lies in a cell that is refined.
bool ErrorOracle::mayRefineBelow(const MeshContext& context, const IndexBox& cells) const {
  NearCells parents(*this, context, 2);
  bool any = false;
  forEachIndex(parentsOf(cells),
               [&](const Index3& parent) { any = any || parents.isRefined(parent); });
  return any;
}

CellBits ErrorOracle::beyondAtLevel1(const MeshContext& context, const Index3& brick) const {
  const BrickLayout& layout = context.pyramid.layout();
  const IndexBox cells = coarseCellsOf(layout, brick);
  if (last_level_ > 1 && !mayRefineBelow(context, cells)) return CellBits(cells);
  FoundAround around;
  const auto ask = [&](const Index3& offset) {
    around.at(offset) = foundIn(context, brick + offset);
  };
  // What another thread makes comes last.
  std::vector<Index3> in_making;
  forEachIndex({Index3(-1), Index3(3)}, [&](const Index3& offset) {
    const Index3 other = brick + offset;
    if (!contains({Index3(0), layout.bricks(0)}, other)) return;
    if (found_.isInMaking(context.pyramid.parts().brickRow(0, other)))
      in_making.push_back(offset);
    else
      ask(offset);
  });
  for (const Index3& offset : in_making) ask(offset);
  return cellsBeyond(context, brick, {isovalue_, tolerance_}, around);
}

CellBits ErrorOracle::beyondBounds(const MeshContext& context, int level,
                                   const Index3& brick) const {
  CellBits cells(context.pyramid.layout().brickCellBox(level, brick));
  std::vector<std::uint8_t> codes;
  context.errorCodes(level, brick, codes);
  const IndexBox& box = cells.box();
  const std::uint8_t* code = codes.data();
  for (std::int64_t z = box.first.z; z < box.end().z; ++z)
    for (std::int64_t y = box.first.y; y < box.end().y; ++y, code += box.count.x) {
      std::uint64_t* const row = cells.row(y, z);
      for (std::int64_t x = 0; x < box.count.x; ++x)
        row[x / 64] |= static_cast<std::uint64_t>(code[x] > greatest_code_) << x % 64;
    }
  return cells;
}

void ErrorOracle::keepBalanced(const MeshContext& context, int level, CellBits& cells) const {
  const Index3 most = context.lattice().cells(level + 1) - Index3(1);
  const IndexBox& box = cells.box();
  NearCells coarser(*this, context, level + 1);
  for (std::int64_t z = box.first.z; z < box.end().z; ++z)
    for (std::int64_t y = box.first.y; y < box.end().y; ++y)
      keepBitsWhere(cells.row(y, z), cells.words(), [&](std::int64_t i) {
        const Index3 cell(box.first.x + i, y, z);
        const Index3 first = glm::max(cell - Index3(1), Index3(0)) / std::int64_t{2};
        const Index3 last = glm::min((cell + Index3(1)) / std::int64_t{2}, most);
        bool are_all = true;
        forEachIndex({first, last - first + Index3(1)},
                     [&](const Index3& coarse) { are_all = are_all && coarser.isRefined(coarse); });
        return are_all;
      });
}

bool ErrorOracle::refines(const MeshContext& context, int level, const Index3& cell) const {
  if (level < 1 || level > last_level_) return true;
  return decided(context, level, brickOf(context, level, cell))->has(cell);
}

void ErrorOracle::keepRefined(const MeshContext& context, int level, const Index3& first,
                              std::int64_t count, std::uint64_t* bits) const {
  if (level < 1 || level > last_level_) return;
  for (std::int64_t begin = 0; begin < count;) {
    const Index3 cell = first + Index3(begin, 0, 0);
    const Index3 brick = brickOf(context, level, cell);
    const std::int64_t end = std::min(count, cellsOf(context, level, brick).end().x - first.x);
    if (!hasBitsBetween(bits, begin, end)) {
      begin = end;
      continue;
    }
    const Bits decided_here = decided(context, level, brick);
    for (std::int64_t word = begin / 64; 64 * word < end; ++word) {
      const std::int64_t from = std::max(begin, 64 * word), to = std::min(end, 64 * (word + 1));
      std::uint64_t kept = 0;
      addBits(decided_here->row(first.y, first.z), first.x + from - decided_here->box().first.x,
              &kept, from % 64, to - from);
      bits[word] &= kept | ~bitsBetween(from, to, word);
    }
    begin = end;
  }
}

}  // namespace isobrick
