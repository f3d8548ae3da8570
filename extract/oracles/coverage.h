// The answer of an oracle for many cells at once.
#pragma once

#include <algorithm>

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// An oracle answers three questions:
//
//   bool refines(int level, const Index3& cell)         is the cell refined, or extracted here?
//   Coverage refinedCoverage(int level, const IndexBox& b)  how many cells of the box are refined?
//   void keepRefined(int level, const Index3& first,    of the cells in a row along x, which are?
//                    std::int64_t count, std::uint64_t* bits)  Clears the bits of the others.
//
// kNone and kAll are certain; kSome may also be the answer for a box that is all of one kind. The
// leaves of an oracle that stands alone are 2:1 balanced (rule 5), and the parent of a cell that it
// refines is refined, so the state of a cell is found without walking down to it. Both hold for
// oracles that are combined too, by the coarser or by the finer one (docs/ALGORITHM.md, section 5).
enum class Coverage { kNone, kSome, kAll };

// The coverage of the cells that two oracles both refine: theirs if the coarser one wins.
inline Coverage coarserCoverage(Coverage a, Coverage b) { return std::min(a, b); }
// The coverage of the cells that one of two refines: theirs if the finer one wins.
inline Coverage finerCoverage(Coverage a, Coverage b) { return std::max(a, b); }

// The smallest box of cells of the next coarser level that covers `cells`, which are not negative.
inline IndexBox parentsOf(const IndexBox& cells) {
  const Index3 first = cells.first / std::int64_t{2};
  const Index3 last = (cells.end() - Index3(1)) / std::int64_t{2};
  return {first, last - first + Index3(1)};
}

}  // namespace isobrick
