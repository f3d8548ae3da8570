// All bricks of a pyramid in the order of its brick table, and the name that errors give one.
#pragma once

#include <string>

#include "isobrick/storage/pyramid.h"

namespace isobrick::test {

// f(level, brick).
template <typename F>
void forAllBricks(const Pyramid& pyramid, F&& f) {
  for (int level = 0; level < pyramid.lattice().levels(); ++level) {
    const Index3 count = pyramid.layout().bricks(level);
    Index3 brick;
    for (brick.z = 0; brick.z < count.z; ++brick.z)
      for (brick.y = 0; brick.y < count.y; ++brick.y)
        for (brick.x = 0; brick.x < count.x; ++brick.x) f(level, brick);
  }
}

inline std::string brickText(int level, const Index3& brick) {
  return "brick (" + std::to_string(brick.x) + "," + std::to_string(brick.y) + "," +
         std::to_string(brick.z) + ") of level " + std::to_string(level);
}

}  // namespace isobrick::test
