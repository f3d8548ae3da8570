// `isobrick build --select channel=all`, `time=all`: a pyramid of each channel and time step.
#pragma once

#include <string>
#include <vector>

#include "tools/build/build_one.h"

namespace isobrick {

// The place that the name of an output lacks for what is asked for with 'all', "channel" or "time";
// and, the other way round, one that it has and nothing fills. Empty: none.
std::string missingPlace(const InputOptions& input, const std::string& output);
std::string idlePlace(const InputOptions& input, const std::string& output);

// The job itself, or one for each channel and time step of its input, whose headers are read for
// that. Names fill {channel} and {time} in the output's; without these they stand behind its stem.
// Numbers of time steps are of one length, so that names sort as they do. Throws as openVolume(),
// and Error for inputs that do not count what is asked for.
std::vector<BuildJob> jobsOfMembers(const BuildJob& job, const BuildSettings& settings);

}  // namespace isobrick
