// The border in which a surface is capped (Query::cap): which bricks, tiles and cells lie in it,
// and may hold a cap.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/grid.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The six planes of the volume's border or, where it lies inside, of the query's box, which cuts no
// leaf (withCappedBox()). Without Query::cap there are none. A value.
class CapBorder {
 public:
  CapBorder(const Lattice& lattice, const SurfaceChoice& choice);

  // The faces of a box of cells of `level` that lie in the border, or beyond: bit f is face f of
  // contour.h. Those of a leaf that overlaps the query's box lie in it.
  unsigned facesOf(const Lattice& lattice, int level, const IndexBox& cells) const;

  // False if neither the isosurface nor a cap reaches the brick (rule 7).
  bool reachesBrick(const Pyramid& pyramid, int level, const Index3& brick, float isovalue) const;
  // PyramidParts::crossedTiles(), and the tiles in the border that have a value inside.
  void findTiles(const Pyramid& pyramid, int level, const Index3& brick, float isovalue,
                 std::vector<std::uint8_t>& out, const CancelFlag* cancel = nullptr) const;

 private:
  bool mayBeInside(const ValueRange& range, float isovalue) const {
    return is_below_ ? range.min < isovalue : range.max >= isovalue;
  }

  bool is_on_;
  bool is_below_;      // Query::inside
  Index3 low_, high_;  // its corners, voxels
};

}  // namespace isobrick
