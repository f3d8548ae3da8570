// `isobrick build` for a list of volumes.
#pragma once

#include <string>
#include <vector>

#include "tools/build/build_one.h"

namespace isobrick {

// Builds one volume after the other, each with all threads, and says so in a line each and a table
// at the end, or with `json` in one object. A volume that fails does not stop the others; why it
// failed goes to stderr too. Returns the exit status: 1 where one failed. Throws Cancelled, once
// what was done is printed.
int runBuildBatch(const std::vector<BuildJob>& jobs, const BuildSettings& settings, bool json);

// True where the word has a wildcard (*, ?, [...]) and no file has that very name.
bool isInputPattern(const std::string& word);

// Every pattern becomes the paths that match it, sorted; all other words stay as they are. Throws
// Error for a pattern that nothing matches.
std::vector<std::string> expandInputs(const std::vector<std::string>& words);

}  // namespace isobrick
