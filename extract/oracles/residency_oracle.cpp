#include "isobrick/extract/oracles/residency_oracle.h"

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

ResidencyOracle::ResidencyOracle(const QueryNeeds& needs, const CancelFlag* cancel)
    : needs_(needs), layout_(needs.pyramid().layout()) {
  while (elementCount(layout_.bricks(first_whole_level_)) > 1) ++first_whole_level_;
  const Pyramid& pyramid = needs_.pyramid();
  const Index3 brick(0);
  for (int level = first_whole_level_; level < pyramid.lattice().levels(); ++level)
    for (const PartKind kind : needs_.kinds()) {
      if (!needs_.mayCross(level, brick)) continue;
      pyramid.parts().require(kind, level, brick, cancel);
      if (auto part = pyramid.parts().holdIfResident(kind, level, brick))
        whole_levels_.push_back(*std::move(part));
    }
}

bool ResidencyOracle::refines(int level, const Index3& cell) {
  return refinedCoverage(level, {cell, Index3(1)}) == Coverage::kAll;
}

Coverage ResidencyOracle::refinedCoverage(int level, const IndexBox& cells) {
  if (level - 1 >= first_whole_level_) return Coverage::kAll;
  if (level == 0) return Coverage::kNone;
  bool any = false, all = true;
  forEachIndex(bricksOfChildren(level, cells), [&](const Index3& brick) {
    const bool is_usable = isUsableOrFindOut(level - 1, brick);
    any = any || is_usable;
    all = all && is_usable;
  });
  return all ? Coverage::kAll : any ? Coverage::kSome : Coverage::kNone;
}

void ResidencyOracle::keepRefined(int level, const Index3& first, std::int64_t count,
                                  std::uint64_t* bits) {
  if (level - 1 >= first_whole_level_) return;
  const std::int64_t brick_cells = layout_.brickCells() / 2;  // of this level
  for (std::int64_t begin = 0; begin < count;) {
    const Index3 cell = first + Index3(begin, 0, 0);
    const std::int64_t end = std::min(count, (cell.x / brick_cells + 1) * brick_cells - first.x);
    if (hasBitsBetween(bits, begin, end) && !refines(level, cell))
      for (std::int64_t word = begin / 64; 64 * word < end; ++word)
        bits[word] &= ~bitsBetween(begin, end, word);
    begin = end;
  }
}

bool ResidencyOracle::isUsableNow(int level, const Index3& brick) {
  return isUsableOrFindOut(level, brick);
}

// Asked for every row of cells, by all threads.
bool ResidencyOracle::isUsableOrFindOut(int level, const Index3& brick) {
  if (level >= first_whole_level_) return true;
  const std::uint64_t facts = known_.of(rowOf(level, brick));
  if (facts != KnownBricks::kNothing) return (facts & KnownBricks::kUsable) != 0;
  const std::lock_guard lock(mutex_);
  return isUsable(level, brick);
}

bool ResidencyOracle::lacksParts(int level, const Index3& brick) {
  const std::lock_guard lock(mutex_);
  if (isUsable(level, brick)) return false;
  bool are_parents_usable = true;
  forEachParentAround(level, brick, [&](const Index3& parent) {
    are_parents_usable = are_parents_usable && isUsable(level + 1, parent);
  });
  return are_parents_usable && !hasOwnParts(level, brick);
}

bool ResidencyOracle::holdsSamples(int level, const Index3& brick) {
  if (level >= first_whole_level_) return true;
  const std::lock_guard lock(mutex_);
  return has(PartKind::kSamples, level, brick);
}

void ResidencyOracle::noteRefused(int level, const IndexBox& cells) {
  forEachIndex(bricksOfChildren(level, cells), [&](const Index3& brick) {
    if (level - 1 < first_whole_level_ &&
        (known_.of(rowOf(level - 1, brick)) & KnownBricks::kRefused) != 0)
      return;
    const std::lock_guard lock(mutex_);
    has_refused_ = true;
    refuse(level - 1, brick);
  });
}

IndexBox ResidencyOracle::bricksOfChildren(int level, const IndexBox& cells) const {
  const Index3 count = layout_.bricks(level - 1);
  const Index3 first = 2L * cells.first / layout_.brickCells();
  const Index3 last = glm::min((2L * cells.end() - Index3(1)) / layout_.brickCells(), count - 1L);
  return {first, last - first + Index3(1)};
}

bool ResidencyOracle::isUsable(int level, const Index3& brick) {
  if (level >= first_whole_level_) return true;
  Brick& known = at(level, brick);
  if (known.usable == Usable::kUnknown) {
    bool is_usable = true;
    forEachParentAround(level, brick, [&](const Index3& parent) {
      is_usable = is_usable && isUsable(level + 1, parent);
    });
    is_usable = is_usable && hasOwnParts(level, brick) && !lacksBorder(level, brick);
    known.usable = is_usable ? Usable::kYes : Usable::kNo;
  }
  const bool is_usable = known.usable == Usable::kYes;
  known_.note(rowOf(level, brick),
              is_usable          ? KnownBricks::kUsable
              : known.is_refused ? std::uint64_t{KnownBricks::kUnusable} | KnownBricks::kRefused
                                 : std::uint64_t{KnownBricks::kUnusable});
  return is_usable;
}

bool ResidencyOracle::hasOwnParts(int level, const Index3& brick) {
  return needs_.areMet(level, brick, whatIsThere());
}

bool ResidencyOracle::lacksBorder(int level, const Index3& brick) {
  return !needs_.hasBorder(level, brick, whatIsThere());
}

bool ResidencyOracle::hasRow(int level, const Index3& brick) const {
  return level >= first_whole_level_ || needs_.pyramid().parts().isRowAtHand(level, brick);
}

bool ResidencyOracle::has(PartKind kind, int level, const Index3& brick) {
  if (level >= first_whole_level_) return true;
  if (!hasRow(level, brick)) return false;
  Brick& known = at(level, brick);
  const auto k = static_cast<std::size_t>(kind);
  if (!known.is_asked[k]) {
    known.is_asked[k] = true;
    known.parts[k] = needs_.pyramid().parts().holdIfResident(kind, level, brick);
  }
  return known.parts[k].has_value();
}

void ResidencyOracle::refuse(int level, const Index3& brick) {
  if (isUsable(level, brick)) return;
  Brick& known = at(level, brick);
  if (known.is_refused) return;
  known.is_refused = true;
  known_.note(rowOf(level, brick), KnownBricks::kUnusable | KnownBricks::kRefused);
  const bool has_own = hasOwnParts(level, brick);
  if (!has_own || lacksBorder(level, brick)) missing_.push_back({level, brick, has_own, !has_own});
  forEachParentAround(level, brick, [&](const Index3& parent) { refuse(level + 1, parent); });
}

}  // namespace isobrick
