// One brick to mesh.
#pragma once

#include "isobrick/storage/grid.h"

namespace isobrick {

struct BrickWork {
  int level = 0;
  Index3 brick{0};
  // False where every cell of the brick, and every cell that touches it, is a leaf of this level:
  // plain marching cubes on the samples as they are.
  bool adaptive = false;
};

}  // namespace isobrick
