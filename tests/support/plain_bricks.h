// Bricks of the plain reader compared with those of the library.
#pragma once

#include <algorithm>

#include "isobrick/storage/pyramid.h"
#include "tests/support/plain_reader.h"

namespace isobrick::test {

inline Index3 indexOf(const PlainBrick& brick) {
  return {brick.index[0], brick.index[1], brick.index[2]};
}

// `samples` are voxels of type T.
template <typename T>
bool areSamplesOf(const PlainBrick& brick, const BrickSamples& samples) {
  return std::equal(brick.samples.begin(), brick.samples.end(), samples.data<T>(),
                    [](float expected, T found) { return static_cast<float>(found) == expected; });
}

}  // namespace isobrick::test
