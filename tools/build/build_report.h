// The output of `isobrick build` about a volume that it built.
#pragma once

#include <string>

#include "tools/build/build_one.h"
#include "tools/json_output.h"

namespace isobrick {

// "none", "lz4" or "zstd", as --codec takes them.
std::string codecOptionName(format::Codec codec);
// --codec and --no-curvature, of all commands that build a pyramid.
void addStoredOptions(CLI::App& app, BuildOptions& options);

Json jsonOfBuilt(const BuildJob& job, const BuiltVolume& built, const BuildSettings& settings);

// Some lines for a volume that was built alone, on stdout.
void printBuilt(const BuiltVolume& built, const BuildSettings& settings);

// One line for a volume among many, without its end.
std::string builtLine(const BuiltVolume& built);

// The facts of a volume that has no pyramid, of its headers, and of some of its voxels: the object
// that `isobrick info` prints. `source` is read, within some seconds, and is of no use afterwards;
// `options` are those that its pyramid would be built with.
Json factsOfVolume(VolumeSource& source, const BuildOptions& options);

}  // namespace isobrick
