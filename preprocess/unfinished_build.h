// The remaining files of a build that fails, and the message to its user.
#pragma once

#include <cstdint>

#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid_writer.h"

namespace isobrick {

struct UnfinishedBuild {
  const VolumeInfo& info;
  const BuildOptions& options;
  InputWatch& input;
  PyramidWriter& writer;
  std::uint64_t bricks = 0;  // of the whole pyramid
};

// For a catch block: throws the current exception as the caller of buildPyramid() gets it. If the
// build can be resumed, the temporary file stays, and the message says so.
[[noreturn]] void throwUnfinished(const UnfinishedBuild& build);

}  // namespace isobrick
