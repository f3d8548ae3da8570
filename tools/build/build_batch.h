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

// For `--select channel=all` and `time=all`: the job itself, or one for each channel and time step
// of its input, whose headers are read for that. Names fill {channel} and {time} in the output's;
// without these they stand behind its stem. Numbers of time steps are of one length, so that names
// sort as they do. Throws as openVolume(), and Error for inputs that do not count what is asked
// for.
std::vector<BuildJob> jobsOfMembers(const BuildJob& job, const BuildSettings& settings);

}  // namespace isobrick
