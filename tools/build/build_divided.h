// isobrick build with an output of many files (preprocess/divided_pyramid.h).
#pragma once

#include <optional>
#include <string>

#include "isobrick/storage/share_number.h"
#include "tools/build/build_one.h"

namespace isobrick {

// Builds those super-bricks of a share that are not up to date, into the job's output, a folder;
// without a share all, and the index. Prints what it did. Returns the exit status.
int runBuildDivided(const BuildJob& job, BuildSettings settings,
                    const std::optional<ShareNumber>& share, bool json);

}  // namespace isobrick
