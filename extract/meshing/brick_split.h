// A brick's leaves in two kinds: plain ones, which only leaves of their level touch, and the
// transition zone.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/meshing/leaf_rows.h"

namespace isobrick {

// The places of leaves on a brick's rows of cells. Only rows with a crossed tile are examined, and
// only cells that the query's box overlaps count. Keeps its memory from brick to brick.
class BrickSplit {
 public:
  // One row of cells that has leaves of the transition zone.
  struct ZoneRow {
    std::int64_t j = 0, k = 0;  // counted from the brick's first cell
  };

  // `rows`: sized for the brick; gets the leaves as its wanted cells. The classifier must live as
  // long as leaves() is used.
  void split(const MeshContext& context, LeafClassifier& classifier, const CrossedTiles& tiles,
             int level, const IndexBox& cells, BrickRows& rows);

  bool hasLeaves() const { return has_plain_ || !zone_rows_.empty(); }
  const std::vector<ZoneRow>& zoneRows() const { return zone_rows_; }
  // The row's leaves of the transition zone in crossed tiles, cell i in bit i % 64 of word i / 64;
  // zeros if the row is not a zone row. Rows beside the brick's, -1 and the count, have none.
  const std::uint64_t* zone(std::int64_t j, std::int64_t k) const {
    return zone_.data() + index(j, k) * words_;
  }
  // The states of the transition zone's cells and of all that touch them.
  const LeafRows& leaves() const { return leaves_; }

 private:
  std::int64_t index(std::int64_t j, std::int64_t k) const {
    return (k + 1) * (cells_.count.y + 2) + j + 1;
  }
  std::uint64_t* zoneAt(std::int64_t j, std::int64_t k) {
    return zone_.data() + index(j, k) * words_;
  }
  void clearZone();
  void splitTileRow(const MeshContext& context, const LeafClassifier& classifier,
                    const CrossedTiles& tiles, std::int64_t y, std::int64_t z, BrickRows& plain);
  void splitRow(const MeshContext& context, std::int64_t j, std::int64_t k, BrickRows& plain);
  void keepOverlapping(const MeshContext& context, std::int64_t j, std::int64_t k,
                       std::uint64_t* bits) const;

  int level_ = 0;
  IndexBox cells_;
  std::int64_t words_ = 0;  // of a row of cells
  bool has_plain_ = false;
  LeafRows leaves_;
  std::vector<std::uint64_t> zone_;
  std::vector<ZoneRow> zone_rows_;
  std::vector<std::uint64_t> row_leaves_, others_;  // of the current row
  std::vector<std::uint64_t> crossed_cells_;        // in crossed tiles of the current row of tiles
};

}  // namespace isobrick
