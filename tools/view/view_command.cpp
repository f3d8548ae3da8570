// isobrick view: a window in which a volume is explored.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/voxel_type.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/window/view_loop.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/outputs.h"
#include "tools/parse_text.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/region_options.h"
#include "tools/shared_options.h"
#include "tools/view/build_volume.h"
#include "tools/view_region.h"

namespace isobrick {
namespace {

struct ViewArguments {
  ViewOptions options;
  PixelSize size{options.width, options.height};
  VolumeInput input;
  std::vector<std::string> files;
  bool steps = false;
  RegionOptions region;
  std::optional<double> preview_share;
  bool force = false;
  bool json = false;
};

// The files that a script writes.
std::vector<std::string> filesOfScript(const ViewOptions& options) {
  std::vector<std::string> files;
  if (!options.script_path.empty())
    for (const ScriptStep& step : readViewScript(options.script_path).steps)
      if (const auto* const file = std::get_if<ScriptFile>(&step))
        files.push_back((std::filesystem::path(options.frames_folder) / file->name).string());
  return files;
}

// All outputs of the words and the script; later outputs of the user get names of their own.
void refuseReplacingOutputs(const ViewOptions& options, bool force) {
  const std::vector<std::string> inputs{options.path, options.script_path, options.state_path};
  if (!options.report_path.empty())
    refuseReplacing({options.report_path, "choose another --report"}, inputs, force);
  for (const std::string& file : filesOfScript(options))
    refuseReplacing({file, "choose another folder with --out-dir"}, inputs, force);
}

// As many steps stay open as have room with all of their voxels.
std::size_t stepsWithRoom(const ViewOptions& options) {
  const auto first =
      openPyramid(options.steps.front(), options.memory_bytes, options.remote, options.cancel).file;
  const Index3& voxels = first->spec().voxels;
  const auto bytes = static_cast<std::uint64_t>(voxels.x * voxels.y * voxels.z) *
                     voxelBytes(first->spec().voxel_type);
  return std::clamp<std::size_t>(options.memory_bytes / bytes, 2, options.steps.size());
}

// Several FILE, or those of the view if none is named, are found before there is a window; beside
// one FILE are those that the view has there. They share the memory.
void openFiles(ViewArguments& arguments) {
  ViewOptions& options = arguments.options;
  std::vector<std::string>& files = arguments.files;
  if (files.size() < 2 && !arguments.steps && !options.state_path.empty()) {
    const SavedView view = readView(options.state_path);
    if (files.empty() && !view.beside.empty()) files.push_back(view.volume);
    files.insert(files.end(), view.beside.begin(), view.beside.end());
  }
  if (arguments.steps && files.size() < 2)
    throw UsageError("--steps goes through several FILE; give more of them");
  if (!arguments.steps && files.size() > kMostVolumes)
    throw UsageError(fmt::format(
        "a scene has at most {} volumes; if these are steps of time, give --steps", kMostVolumes));
  const std::vector<std::string> names = files;
  for (std::size_t i = arguments.steps ? 0 : 1; i < files.size(); ++i) {
    VolumeInput input = arguments.input;
    input.path = files[i];
    findPyramid(input, options.threads, options.memory_bytes);
    files[i] = input.pyramid;
  }
  if (!files.empty()) options.path = arguments.input.path = files.front();
  if (arguments.steps) {
    options.steps = files;
    options.step_names = names;
    options.steps_open = stepsWithRoom(options);
    options.memory_bytes /= options.steps_open;
    return;
  }
  options.memory_bytes /= std::max<std::size_t>(1, files.size());
  for (std::size_t i = 1; i < files.size(); ++i) {
    options.beside.push_back(
        openPyramid(files[i], options.memory_bytes, options.remote, options.cancel));
    options.beside.back().source = names[i];
  }
}

// That of the words, or of the view.
void openRegion(ViewArguments& arguments) {
  ViewOptions& options = arguments.options;
  RegionOptions& region = arguments.region;
  if (region.isEverywhere() && !options.state_path.empty())
    region = regionOptionsOf(readView(options.state_path).state.region);
  findMasks(region, arguments.input.cache_folder, options.threads, options.memory_bytes);
  // They share the memory with the volume.
  options.memory_bytes /= 1 + region.masks.size();
  openMasks(region, options.memory_bytes, FileAccess::kMap, options.remote);
  options.region = viewRegionOf(region);
  options.masks = openMasksOf(region);
}

int runViewCommand(ViewArguments& arguments) {
  ViewOptions& options = arguments.options;
  const Stopwatch watch;
  options.remote = remoteOptions(arguments.input);
  const std::vector<std::string> names = arguments.files;
  openFiles(arguments);
  refuseReplacingOutputs(options, arguments.force);
  if (!isVolume(options.path)) {  // of which another volume may be made, before there is a window
    findPyramid(arguments.input, options.threads, options.memory_bytes);
    options.path = arguments.input.pyramid;
  }
  openRegion(arguments);
  options.build = volumeBuilder({arguments.input, options.threads + 1, arguments.preview_share});
  // A file that a script opens was not chosen by the user.
  if (options.script_path.empty()) options.recent_path = recentFilesPath();
  options.width = arguments.size.width;
  options.height = arguments.size.height;
  // The interface is beside them.
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(options.threads) + 1);
  runView(options);
  if (!arguments.json) return 0;
  const auto orNull = [](const std::string& path) { return path.empty() ? Json() : Json(path); };
  Json json = {{"volumes", Json::array()},
               {"state", orNull(options.state_path)},
               {"script", orNull(options.script_path)},
               {"written", filesOfScript(options)},
               {"report", orNull(options.report_path)},
               {"seconds", watch.seconds()},
               {"threads", options.threads},
               {"peak_rss_bytes", peakResidentBytes()}};
  for (const std::string& name : names) json["volumes"].push_back(withoutSecrets(name));
  printJson(json);
  return 0;
}

void addScriptOptions(CLI::App& app, ViewArguments& arguments) {
  ViewOptions& options = arguments.options;
  beginGroup(app, kScriptGroup);
  CLI::Option* const script = app.add_option("--script", options.script_path,
                                             "Timed inputs in place of a user; leaves at their end "
                                             "(docs/reference/views-and-scripts.md)")
                                  ->type_name("EVENTS.json");
  app.add_option("--out-dir", options.frames_folder,
                 "Folder for the files that the script writes; default: this one")
      ->type_name("DIR")
      ->needs(script);
  app.add_option("--report", options.report_path, "Times of the script's frames, as JSON")
      ->type_name("R.json")
      ->needs(script);
  addForceFlag(app, arguments.force);
  addJsonFlag(app, arguments.json)
      ->description(
          "At the end, print what was shown and what the script wrote as one JSON object");
  app.add_flag("--offscreen", options.offscreen, "Run the script without a window")->needs(script);
}

}  // namespace

Command addViewCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("view", kViewDescription);
  const auto arguments = std::make_shared<ViewArguments>();
  ViewOptions& options = arguments->options;
  options.memory_bytes = kDefaultMemoryBytes;
  options.gpu_budget_bytes = std::uint64_t{1} << 30;
  // One core is for the interface.
  options.threads = std::max(1, allCores() - 1);
  options.cancel = &interruptFlag();
  CLI::Option* const file = addVolumeInputs(*sub, arguments->files);
  file->description(file->get_description() + "; default: chosen in the window");
  sub->add_flag(
      "--steps", arguments->steps,
      "Each FILE is a step of time, all of one grid: the panel has a slider for them, and "
      "plays them; "
      "without it they are volumes of one scene");
  addVolumeOptions(*sub, arguments->input);
  addRegionOptions(*sub, arguments->region, false);
  addParsedOption(
      *sub, "--preview-share", arguments->preview_share, numberFrom(0), "S",
      "Share of a build's time that previews may take; 0: none are made; default: that of "
      "'isobrick build'");
  beginGroup(*sub, kResourceGroup);
  addMemoryOption(*sub, options.memory_bytes);
  addParsedOption(*sub, "--gpu-memory", options.gpu_budget_bytes, parseByteSize, "SIZE",
                  "Bytes of triangles to keep on the graphics card; default: 1G");
  addThreadsOption(*sub, options.threads);
  beginGroup(*sub, kWindowGroup);
  addParsedOption(*sub, "--size", arguments->size, parsePixelSize, "WxH",
                  "Pixels; default: 1280x800");
  sub->add_option(
         "--state", options.state_path,
         "Saved view; to begin with, as Ctrl+S writes it; read and written by Ctrl+O and Ctrl+S")
      ->type_name("VIEW.json");
  addScriptOptions(*sub, *arguments);
  sub->footer(R"(
Example:
  isobrick view head.isb --memory 512M --size 1600x1000
  isobrick view ct.isb pet.isb            in one world
  isobrick view run-*.isb --steps
H lists the keys.)");
  return {sub, [arguments] { return runViewCommand(*arguments); }};
}

// Of the executable `isobrick-view`, which `isobrick` starts.
std::vector<Command> addCommands(CLI::App& app) { return {addViewCommand(app)}; }

std::optional<std::string> commandOfFile(const std::string&) { return std::nullopt; }

void runExternalCommand(std::string_view, char**) {}

}  // namespace isobrick
