// Which cells of level 1 are beyond a tolerance, by what is refined around them (rule 15).
#pragma once

#include <array>
#include <memory>

#include "isobrick/extract/oracles/error_cells.h"

namespace isobrick {

// What a brick of level 0 and those around it have found, by their offset from it, -1 to 1 along
// each axis; null outside of the volume.
class FoundAround {
 public:
  std::shared_ptr<const FoundCells>& at(const Index3& offset) {
    return found_[static_cast<std::size_t>(linearIndex(offset + Index3(1), Index3(3)))];
  }
  const std::shared_ptr<const FoundCells>& at(const Index3& offset) const {
    return found_[static_cast<std::size_t>(linearIndex(offset + Index3(1), Index3(3)))];
  }

 private:
  std::array<std::shared_ptr<const FoundCells>, 27> found_;
};

// The cells of level 1 in the brick that are to be refined. Of those that may be beyond the
// tolerance (FoundCells), in turn:
//
//   - those that are beyond it amidst leaves of level 0, and those that level 0 does not cross,
//     which make no triangles,
//   - of the even ones, the sum of whose indices is, those that are beyond it still where corners
//     that touch a cell of the first kind that is crossed have their samples of level 0, as they
//     have once it is refined,
//   - of the odd ones, those that are beyond it where corners that touch such an even cell too have
//     these.
//
// All others are within the tolerance whatever else is refined, since the corners of which nothing
// is said may have either sample. The same cells for bricks of any size. Takes samples of the brick
// and those around where level 0 crosses a cell in them that may be beyond.
CellBits cellsBeyond(const MeshContext& context, const Index3& brick, const ErrorBound& bound,
                     const FoundAround& around);

}  // namespace isobrick
