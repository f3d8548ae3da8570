// What an oracle says of many cells at once.
#pragma once

#include <algorithm>

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// An oracle answers three questions:
//
//   bool refines(int level, const Index3& cell)         is the cell refined, or extracted here?
//   Share shareOfRefined(int level, const IndexBox& b)  of the cells in the box, how many are?
//   void keepRefined(int level, const Index3& first,    of the cells in a row along x, which are?
//                    std::int64_t count, std::uint64_t* bits)  Clears the bits of the others.
//
// kNone and kAll are certain; kSome may also be said of a box that is all of one kind. The leaves
// of an oracle that stands alone are 2:1 balanced (rule 5), and the parent of a cell that it
// refines is refined, so whether a cell is a leaf can be asked without walking down to it. Both
// hold for oracles that are combined too, by the coarser or by the finer one (docs/ALGORITHM.md,
// section 5).
enum class Share { kNone, kSome, kAll };

// The share of the cells that two oracles both refine: what they give where the coarser one wins.
inline Share coarserShare(Share a, Share b) { return std::min(a, b); }
// Of the cells that one of two refines: what they give where the finer one wins.
inline Share finerShare(Share a, Share b) { return std::max(a, b); }

// The smallest box of cells of the next coarser level that covers `cells`, which are not negative.
inline IndexBox parentsOf(const IndexBox& cells) {
  const Index3 first = cells.first / std::int64_t{2};
  const Index3 last = (cells.end() - Index3(1)) / std::int64_t{2};
  return {first, last - first + Index3(1)};
}

}  // namespace isobrick
