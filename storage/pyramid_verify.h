// Checking a whole pyramid: that every byte is what was written, and means what it should.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/pyramid.h"

namespace isobrick {

// A fault of one brick.
struct BrickDamage {
  int level = 0;     // of the brick
  Index3 brick{0};   // its place among the bricks of the level
  std::string what;  // does not say which brick
};

// Reads every part of one brick and says what is wrong with it: bytes, samples that are not
// finite, and ranges that are not just what section 6 of docs/FORMAT.md says. For the latter it
// also reads tile ranges of the next finer level and samples of coarser ones; if it is their
// fault, or they cannot be read, this brick is not named.
std::optional<BrickDamage> verifyBrick(const Pyramid& pyramid, int level, const Index3& brick);

// The faults outside of the bricks, a line each: reserved fields and padding that are not
// zero, parts that overlap, a value range that is not that of the voxels. Reads the padding.
std::vector<std::string> verifyRest(const Pyramid& pyramid, const CancelFlag* cancel = nullptr);

// How verifyPyramid() goes about it.
struct VerifyOptions {
  int threads = 0;                                // 0: all cores
  std::function<void(double fraction)> progress;  // 0 .. 1; by one thread at a time
  const CancelFlag* cancel = nullptr;             // looked at before every brick
};

// The faults that verifyPyramid() found.
struct PyramidFaults {
  std::vector<BrickDamage> bricks;  // in the order of the file's brick table
  std::vector<std::string> rest;    // as verifyRest() says it

  // Whether all is well.
  bool empty() const { return bricks.empty() && rest.empty(); }
};

// Both of the whole file. Throws Cancelled.
PyramidFaults verifyPyramid(const Pyramid& pyramid, const VerifyOptions& options = {});

}  // namespace isobrick
