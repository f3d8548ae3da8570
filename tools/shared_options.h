// Options that mean the same in every command that has them.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/pyramid.h"
#include "tools/parse_text.h"
#include "tools/parsed_option.h"

namespace isobrick {

// The groups of --help, in the order in which commands add to them; kVolumeGroup (volume_input.h)
// is one more.
inline constexpr char kSurfaceGroup[] = "Surface", kDetailGroup[] = "Detail",
                      kOutputGroup[] = "Output", kPictureGroup[] = "Picture",
                      kPyramidGroup[] = "Pyramid", kInputGroup[] = "Input",
                      kMeasuringGroup[] = "Measuring", kWindowGroup[] = "Window",
                      kScriptGroup[] = "Scripts", kResourceGroup[] = "Resources",
                      kProgramGroup[] = "For programs";

// Options that are added to the command from now on belong to this group.
inline void beginGroup(CLI::App& app, const char* group) { app.option_defaults()->group(group); }

// The default of --memory in every command.
inline constexpr std::uint64_t kDefaultMemoryBytes = Pyramid::kDefaultBudgetBytes;
static_assert(kDefaultMemoryBytes == std::uint64_t{1} << 30);  // as in --help

inline CLI::Option* addMemoryOption(CLI::App& app, std::uint64_t& bytes) {
  return addParsedOption(app, "--memory", bytes, parseByteSize, "SIZE",
                         "Bound of what stays in memory, such as 300M or 2G; default: 1G");
}

inline CLI::Option* addJsonFlag(CLI::App& app, bool& json) {
  return app.add_flag("--json", json, "Print one JSON object in place of text");
}

// --select, which calls `select` with one word KEY=VALUE at a time.
template <typename Select>
CLI::Option* addSelectOption(CLI::App& app, Select select) {
  return addRepeatedOption(
      app, "--select", select, "KEY=VALUE",
      "Which volume of several in the input; KEY is array or grid (the array, grid, stack or layer "
      "of this name), series (number or UID), time, channel, image (from 0), or component (from "
      "0, or magnitude, the root of the sum of all squares); may be given again");
}

inline constexpr char kMaskNanHelp[] =
    "Voxels that are NaN have no data: cells that touch one are left out, and surfaces are open "
    "there";

template <typename Level>
CLI::Option* addLevelOption(CLI::App& app, Level& level, int coarsest) {
  return addParsedOption(app, "--level", level, integerWithin(0, coarsest), "L",
                         "This level of the pyramid everywhere; 0 is the finest");
}

inline CLI::Option* addBoxOption(CLI::App& app, std::optional<Corners>& box) {
  return addParsedOption(app, "--box", box, parseCorners, "X0,Y0,Z0,X1,Y1,Z1",
                         "Only this box of voxel indices of level 0, both corners included; of a "
                         "surface, the cells that it touches");
}

}  // namespace isobrick
