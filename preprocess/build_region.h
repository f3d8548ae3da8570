// The bricks that one build makes, and what it takes to make them.
#pragma once

#include "isobrick/preprocess/brick_window.h"
#include "isobrick/storage/pyramid_division.h"

namespace isobrick {

// A whole pyramid, one super-brick of a divided one, or the levels above all super-bricks.
//
// The region makes its own bricks of some levels, level by level, and passes samples on from each
// to the next. Bricks around a super-brick's own are read as far as its coarser levels take their
// samples, and are not made. Pure arithmetic.
class BuildRegion {
 public:
  // The bricks of a file of a divided pyramid; without one, the whole pyramid. The first input of
  // the index's comes from the super-bricks.
  explicit BuildRegion(const PyramidSpec& spec,
                       const std::optional<DividedFile>& file = std::nullopt);

  const BrickNeeds& needs() const { return needs_; }
  const BrickLayout& layout() const { return needs_.layout(); }
  // Its own bricks.
  const TableRows& rows() const { return rows_; }
  int firstLevel() const { return rows_.firstLevel(); }
  int endLevel() const { return rows_.endLevel(); }
  bool isOwn(int level, const Index3& brick) const { return contains(rows_.bricks(level), brick); }

  // The bricks that windows are cut from: its own, and those that pass samples on to them.
  const IndexBox& windowBricks(int level) const { return read_[place(level)]; }
  // Samples of level + 1, and tiles of `level`, that it passes on. Empty at the top of the pyramid.
  // For the level below its first one all that it takes.
  IndexBox passedSamples(int level) const;
  IndexBox passedTiles(int level) const;

  // The samples that a window of these bricks takes, and those that it passes on, which may be
  // none.
  IndexBox samples(int level, const IndexBox& bricks) const;
  IndexBox handedOn(int level, const IndexBox& bricks) const;

 private:
  std::size_t place(int level) const { return static_cast<std::size_t>(level - firstLevel()); }
  void passOn();

  PyramidSpec spec_;
  BrickNeeds needs_;
  TableRows rows_;
  std::vector<IndexBox> read_, passed_;  // for each of its levels
};

}  // namespace isobrick
