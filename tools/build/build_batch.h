// `isobrick build` for a list of volumes.
#pragma once

#include <vector>

#include "tools/build/build_one.h"

namespace isobrick {

// Builds one volume after the other, each with all threads, and says so in a line each and a table
// at the end, or with `json` in one object. A volume that fails does not stop the others; why it
// failed goes to stderr too. Returns the exit status: 1 where one failed. Throws Cancelled, once
// what was done is printed.
int runBuildBatch(const std::vector<BuildJob>& jobs, const BuildSettings& settings, bool json);

}  // namespace isobrick
