// `isobrick build` for a list of volumes.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "tools/build/build_one.h"

namespace isobrick {

// Builds one volume after the other, each with all threads, and prints a line for each and a table
// at the end, or with `json` in one object. A volume that fails does not stop the others; the
// reason goes to stderr too. Returns the exit status: 1 if one failed. Throws Cancelled, once the
// results so far are printed.
int runBuildBatch(const std::vector<BuildJob>& jobs, const BuildSettings& settings, bool json);

// The files of a sequence, "smoke.%04d.vdb", with their numbers; none for other words, and for a
// name that a file has.
std::vector<std::pair<std::int64_t, std::string>> filesOfSequence(const std::string& word);

// True if the word has a wildcard (*, ?, [...]), or is the name of a sequence, and no file has that
// very name.
bool isInputPattern(const std::string& word);

// Every pattern becomes the paths that match it, sorted; all other words stay as they are. Throws
// Error for a pattern that nothing matches.
std::vector<std::string> expandInputs(const std::vector<std::string>& words);

}  // namespace isobrick
