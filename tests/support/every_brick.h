// All bricks of a pyramid in the order of its brick table.
#pragma once

#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick::test {

// f(level, brick).
template <typename F>
void forAllBricks(const Pyramid& pyramid, F&& f) {
  for (int level = 0; level < pyramid.lattice().levels(); ++level)
    forEachIndex({Index3(0), pyramid.layout().bricks(level)},
                 [&](const Index3& brick) { f(level, brick); });
}

}  // namespace isobrick::test
