// The formats of each option: an option that would change nothing is refused, not ignored.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Throw UsageError for the first option that was given to `parser` and is not for the format of the
// input, as its source names it, or of the output, by its ending.
void refuseUnfitInputOptions(const CLI::App& parser, const VolumeInfo& input);
void refuseUnfitOutputOptions(const CLI::App& parser, const std::string& output);

}  // namespace isobrick
