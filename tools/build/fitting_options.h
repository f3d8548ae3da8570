// Which option goes with which format: one that would change nothing is refused, not ignored.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Throw UsageError for the first option that was given to `parser` and is not for the format of
// what is read, as its source names it, or of what is written, as its name ends.
void refuseUnfitInputOptions(const CLI::App& parser, const VolumeInfo& input);
void refuseUnfitOutputOptions(const CLI::App& parser, const std::string& output);

}  // namespace isobrick
