// The output of `isobrick build` about a volume that it built.
#pragma once

#include <string>

#include "tools/build/build_one.h"
#include "tools/json_output.h"

namespace isobrick {

// "none", "lz4" or "zstd", as --codec takes them.
std::string codecOptionName(format::Codec codec);

Json jsonOfBuilt(const BuildJob& job, const BuiltVolume& built, const BuildSettings& settings);

// Some lines for a volume that was built alone, on stdout.
void printBuilt(const BuiltVolume& built, const BuildSettings& settings);

// One line for a volume among many, without its end.
std::string builtLine(const BuiltVolume& built);

}  // namespace isobrick
