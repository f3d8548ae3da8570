// What a query does, before it is done: the bricks to mesh, in order.
#pragma once

#include <span>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// One brick to mesh.
struct BrickWork {
  int level = 0;
  Index3 brick{0};
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
  const Query& query() const { return query_; }
  std::span<const BrickWork> bricks() const { return bricks_; }

 private:
  friend class Extractor;
  Query query_;
  std::vector<BrickWork> bricks_;
};

}  // namespace isobrick
