// Checks a whole pyramid: every byte is as it was written, and the contents fit together.
#pragma once

#include <cstddef>
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
  std::string what;  // the fault, without the brick's name
};

// Reads every part of one brick and describes its fault: damaged bytes, samples that are not
// finite, or ranges that do not take in the brick's own samples.
std::optional<BrickDamage> verifyBrick(const Pyramid& pyramid, int level, const Index3& brick);

// The faults outside of the bricks, a line each: reserved fields and padding that are not
// zero, parts that overlap, a value range that is not that of the voxels. Reads the padding.
std::vector<std::string> verifyRest(const Pyramid& pyramid, const CancelFlag* cancel = nullptr);

// Options of verifyPyramid().
struct VerifyOptions {
  int threads = 0;                                // 0: all cores
  std::function<void(double fraction)> progress;  // 0 .. 1; by one thread at a time
  const CancelFlag* cancel = nullptr;             // checked before every brick
};

// The faults that verifyPyramid() found.
struct PyramidFaults {
  std::vector<BrickDamage> bricks;  // in the order of the file's brick table
  std::vector<std::string> rest;    // as verifyRest() says it
  std::size_t lost_bricks = 0;      // in files that cannot be opened, which `rest` names

  // Whether no fault was found.
  bool empty() const { return bricks.empty() && rest.empty(); }
};

// Checks every brick and the rest of the file; a fault is a result and no exception. Throws
// Cancelled.
PyramidFaults verifyPyramid(const Pyramid& pyramid, const VerifyOptions& options = {});

}  // namespace isobrick
