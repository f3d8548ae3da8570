// Options that mean the same in every command that has them.
#pragma once

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

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

namespace isobrick {

// Adds an option that sets `target` to `parse(text)`. `target` lives as long as the parser; its
// type is that of the result or an optional of it. CLI11's own conversions depend on the locale and
// take "nan".
template <typename Target, typename Parse>
CLI::Option* addParsedOption(CLI::App& app, const std::string& names, Target& target, Parse parse,
                             const std::string& value_name, const std::string& description) {
  const auto set = [&target, parse, names](const std::string& text) {
    try {
      target = static_cast<Target>(parse(text));
    } catch (const std::invalid_argument& failure) {
      throw CLI::ValidationError(names, failure.what());
    }
  };
  return app.add_option_function<std::string>(names, set, description)->type_name(value_name);
}

// A parser of lengths, which are voxels, or, with a unit at their end, millimetres of the world;
// `in_world` is set to which of them, and lives as long as the parser.
template <typename Parse>
auto parserOfLengths(Parse parse, bool& in_world) {
  return [parse, &in_world](std::string text) {
    const std::optional<double> millimetres = takeLengthUnit(text);
    in_world |= millimetres.has_value();
    return parse(text) * millimetres.value_or(1.0);
  };
}

// Adds an option that may be given again: calls `take(word)` for each of its words.
template <typename Take>
CLI::Option* addRepeatedOption(CLI::App& app, const std::string& name, Take take,
                               const std::string& value_name, const std::string& description) {
  const auto take_all = [take, name](const std::vector<std::string>& words) {
    try {
      for (const std::string& word : words) take(word);
    } catch (const std::invalid_argument& failure) {
      throw CLI::ValidationError(name, failure.what());
    }
  };
  return app.add_option_function<std::vector<std::string>>(name, take_all, description)
      ->type_name(value_name)
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
}

// The values of an option, in the order of --help.
template <typename T>
using Choices = std::vector<std::pair<std::string, T>>;

// Adds an option that sets `target` to the value of one of the choices.
template <typename T>
CLI::Option* addChoiceOption(CLI::App& app, const std::string& name, T& target,
                             const Choices<T>& choices, const std::string& value_name,
                             const std::string& description) {
  const auto set = [&target, choices](const std::string& text) {
    for (const auto& [word, value] : choices)
      if (word == text) target = value;
  };
  return app.add_option_function<std::string>(name, set, description)
      ->type_name(value_name)
      ->check(CLI::IsMember(choices));
}

// The groups of --help, in the order in which commands add to them; kVolumeGroup (volume_input.h)
// is one more.
inline constexpr char kSurfaceGroup[] = "Surface", kDetailGroup[] = "Detail",
                      kOutputGroup[] = "Output", kPictureGroup[] = "Picture",
                      kPyramidGroup[] = "Pyramid", kInputGroup[] = "Input",
                      kMeasuringGroup[] = "Measuring", kWindowGroup[] = "Window",
                      kScriptGroup[] = "Scripts", kResourceGroup[] = "Resources",
                      kProgramGroup[] =
                          "Programs";  // for other programs and for measuring: not in --help

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
      "of this name), series (number or UID), time, channel, image (from 0; 'isobrick build' takes "
      "time=all and channel=all), or component (from 0, or magnitude, the root of the sum of all "
      "squares); may be given again");
}

inline constexpr char kSpacingHelp[] =
    "Distances between voxels, in place of what the input says or lacks; in the units of the "
    "world, or with a unit, 0.65,0.65,2um";
inline constexpr char kOriginHelp[] =
    "Place of the first voxel in the world, in place of the input's own or missing one; likewise";
inline constexpr char kInputUnitHelp[] =
    "Unit of the lengths in the input, such as um, if it says none or a wrong one; also of "
    "--spacing and --origin that have none";

inline constexpr char kMaskNanHelp[] =
    "Voxels that are NaN have no data: cells that touch one are left out, and surfaces are open "
    "there";

template <typename Level>
CLI::Option* addLevelOption(CLI::App& app, Level& level, int coarsest) {
  return addParsedOption(app, "--level", level, integerWithin(0, coarsest), "L",
                         "This level of the pyramid everywhere; 0 is the finest");
}

inline CLI::Option* addBoxOption(CLI::App& app, std::optional<Corners>& box,
                                 bool* in_world = nullptr) {
  constexpr char kHelp[] =
      "Only this box of voxel indices of level 0, both corners included; of a surface, the cells "
      "that it touches";
  if (in_world == nullptr)
    return addParsedOption(app, "--box", box, parseCorners, "X0,Y0,Z0,X1,Y1,Z1", kHelp);
  return addParsedOption(app, "--box", box, parserOfLengths(parseCorners, *in_world),
                         "X0,Y0,Z0,X1,Y1,Z1[mm]", kHelp);
}

// All cores that the process may use.
inline int allCores() { return tbb::this_task_arena::max_concurrency(); }

inline void addThreadsOption(CLI::App& app, int& threads) {
  addParsedOption(app, "--threads", threads, integerWithin(1, 1024), "N",
                  "Threads to use; default: all cores");
}

// Calls `work()` with TBB limited to `threads` threads, the calling one included.
template <typename Work>
auto runWithThreads(int threads, Work&& work) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  return arena.execute(std::forward<Work>(work));
}

}  // namespace isobrick
