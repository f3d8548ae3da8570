// What a query does: before it is done the bricks to mesh, in order, and after that the counts.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// One brick to mesh.
struct BrickWork {
  int level = 0;    // of the brick
  Index3 brick{0};  // its place among the bricks of the level
  // False where every cell of the brick, and every cell that touches it, is a leaf of this level:
  // plain marching cubes on the samples as they are.
  bool adaptive = false;
};

// Every brick that may hold a part of the surface, in the order in which its batches come out.
// Found in memory from ranges and oracles alone; nothing was read from the file. Its size is that
// of the surface, not of the file. A value: may be copied, cut in ranges and executed any number of
// times. The query's cancel flag, where it has one, must live as long as the plan is executed.
class ExtractionPlan {
 public:
  // What it is the plan of.
  const Query& query() const { return query_; }
  // In the order in which their batches come out.
  std::span<const BrickWork> bricks() const { return bricks_; }

 private:
  friend class Extractor;
  Query query_;
  std::vector<BrickWork> bricks_;
};

// What an extraction made of one level.
struct LevelCounts {
  int level = 0;                       // of the pyramid
  std::uint64_t cells = 0;             // leaves with at least one triangle
  std::uint64_t triangles = 0;         // of all its leaves
  std::uint64_t transition_cells = 0;  // cells whose triangles are fans
};

// What an extraction did.
struct ExtractionReport {
  bool is_complete = true;          // false: coarser than asked for; of progressive queries alone
  std::uint64_t triangles = 0;      // of all levels
  std::vector<LevelCounts> levels;  // those with triangles, finest first
  std::uint64_t bricks_active = 0;  // bricks with at least one triangle
  std::uint64_t bricks_read = 0;    // bricks of which any part was asked for
  std::uint64_t bytes_active = 0;   // stored bytes of the samples of active bricks
  std::uint64_t bytes_read = 0;     // stored bytes of all parts asked for, each counted once
};

}  // namespace isobrick
