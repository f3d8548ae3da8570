// isobrick build: volumes in, pyramids out.
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/share_number.h"
#include "tools/build/build_batch.h"
#include "tools/build/build_divided.h"
#include "tools/build/build_one.h"
#include "tools/build/build_report.h"
#include "tools/command.h"
#include "tools/extract_surface.h"
#include "tools/outputs.h"
#include "tools/parse_text.h"
#include "tools/plain_text.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

struct BuildArguments {
  std::vector<std::string> inputs;
  InputOptions input;
  std::string output, out_dir;
  bool json = false;
  std::optional<ShareNumber> part;
  std::int64_t super_cells = 0;  // 0: not given
  BuildSettings settings{{}, allCores()};

  bool isDivided() const { return isDividedName(output); }
};

// The folder of --out-dir. One that was made here is removed if nothing is in it at the end.
class OutputFolder {
 public:
  explicit OutputFolder(const std::string& path) : path_(path) {
    if (path.empty()) return;
    if (isFolder(path)) return;
    if (isPresent(path))
      throw Error(fmt::format("'{}' is not a folder; choose another --out-dir", path));
    is_ours_ = mkdir(path.c_str(), 0777) == 0;
    if (!is_ours_)
      throw Error(
          fmt::format("cannot make the folder '{}': {}; create the folder above it, or "
                      "choose another --out-dir",
                      path, std::strerror(errno)));
    syncFolderOf(path);
  }
  ~OutputFolder() {
    if (is_ours_) removeName(path_);
  }
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

 private:
  std::string path_;
  bool is_ours_ = false;
};

std::vector<BuildJob> makeJobs(const BuildArguments& arguments,
                               const std::vector<std::string>& inputs) {
  std::vector<BuildJob> jobs;
  for (const std::string& input : inputs) {
    BuildJob job;
    job.input = arguments.input;
    job.input.path = input;
    job.output = withPlaceFilled(arguments.output, "name", inputStem(defaultOutputName(input)));
    if (job.output.empty())
      job.output = (fs::path(arguments.out_dir) / defaultOutputName(input)).string();
    const std::vector<InputOptions> grids = inputsOfGrids(job.input);
    for (const InputOptions& grid : grids) {
      BuildJob of_grid = job;
      of_grid.input = grid;
      // The name comes from the file, which may be a stranger's.
      if (grids.size() > 1) of_grid.output = nameWith(job.output, plainName(grid.grids.front()));
      for (BuildJob& one : jobsOfMembers(of_grid, arguments.settings))
        jobs.push_back(std::move(one));
    }
  }
  return jobs;
}

// A fault of the words themselves is reported before anything starts; a fault of one
// input waits for its turn.
void checkUsage(const BuildArguments& arguments, const std::vector<BuildJob>& jobs) {
  const BuildOptions& options = arguments.settings.options;
  if (options.tile_cells > options.brick_cells)
    throw UsageError("--tile is larger than --brick; a brick is made of tiles");
  if (jobs.size() > 1 && !arguments.settings.cache_folder.empty())
    throw UsageError("several grids are several pyramids; choose one with --select grid=NAME");
  if (jobs.size() > 1 && arguments.isDivided())
    throw UsageError(
        fmt::format("--output names one pyramid, and there are {} grids; choose one "
                    "with --select grid=NAME",
                    jobs.size()));
  std::map<std::string, const InputOptions*> input_of;
  for (const BuildJob& job : jobs) {
    const std::string& input = job.input.path;
    const auto [place, is_new] = input_of.emplace(job.output, &job.input);
    const InputOptions& other = *place->second;
    if (!is_new && other.path == input && other.channel == job.input.channel &&
        other.time == job.input.time && other.grids == job.input.grids)
      throw UsageError(fmt::format("the input '{}' is given twice", input));
    if (!is_new)
      throw UsageError(
          fmt::format("'{}' and '{}' would both become '{}'; build one of them alone, "
                      "under another name with -o",
                      other.path, input, job.output));
    try {
      refuseKnownMisfits(job.input);
    } catch (const Error&) {
    }
  }
}

// One name for several outputs has a place for what tells them apart. Of a fault here no input is
// opened.
void checkNames(const BuildArguments& arguments, std::size_t inputs) {
  const bool has_all = arguments.input.all_times || arguments.input.all_channels;
  if (has_all && !arguments.settings.cache_folder.empty())
    throw UsageError(
        "--select channel=all and time=all are for 'isobrick build', which makes a pyramid of "
        "each; name those, or choose one");
  if (has_all && arguments.isDivided())
    throw UsageError(
        "--select channel=all and time=all are for pyramids of one file; write "
        "OUT.isb, or choose one");
  if (arguments.output.empty()) return;
  for (const auto& [place, is_filled] : {std::pair("channel", arguments.input.all_channels),
                                         std::pair("time", arguments.input.all_times)}) {
    const bool has_place = hasPlace(arguments.output, place);
    if (is_filled && !has_place)
      throw UsageError(
          fmt::format("--output names one pyramid, and --select {0}=all makes one of "
                      "each; write {{{0}}} in it, as in scan-{{{0}}}.isb",
                      place));
    if (!is_filled && has_place)
      throw UsageError(
          fmt::format("{{{0}}} in --output goes with --select {0}=all; give that, too", place));
  }
  if (inputs > 1 && arguments.isDivided())
    throw UsageError(fmt::format(
        "an output of many files is of one volume, and there are {} inputs; build them in calls of "
        "their own",
        inputs));
  if (inputs > 1 && !hasPlace(arguments.output, "name"))
    throw UsageError(
        fmt::format("--output names one pyramid, and there are {} inputs; give the "
                    "folder for all with --out-dir, or write {{name}} in it",
                    inputs));
}

// The output is one file, or a folder of many.
void checkDivision(const BuildArguments& arguments) {
  const char* const given = arguments.part               ? "--part"
                            : arguments.super_cells != 0 ? "--super-brick"
                                                         : nullptr;
  if (given != nullptr && !arguments.isDivided())
    throw UsageError(
        fmt::format("{} is for pyramids of many files; name the folder with -o OUT.isbs", given));
  const bool has_previews = !arguments.settings.options.preview.folder.empty();
  if (arguments.isDivided() && has_previews)
    throw UsageError("--preview-folder is for pyramids of one file");
  if (has_previews && arguments.settings.progress != ProgressStyle::kLines)
    throw UsageError("--preview-folder goes with --progress-lines");
  if (arguments.isDivided() && arguments.settings.options.mask_nan)
    throw UsageError("--mask-nan is for pyramids of one file; write OUT.isb, or give --nan-as V");
}

int runBuild(BuildArguments arguments) {
  checkDivision(arguments);
  if (arguments.isDivided())
    arguments.settings.options.super_cells =
        arguments.super_cells != 0 ? arguments.super_cells : kDefaultSuperCells;
  const std::vector<std::string> inputs = expandInputs(arguments.inputs);
  checkNames(arguments, inputs.size());
  const std::vector<BuildJob> jobs = makeJobs(arguments, inputs);
  checkUsage(arguments, jobs);
  const OutputFolder folder(arguments.out_dir);
  const BuildSettings& settings = arguments.settings;
  if (arguments.isDivided())
    return runBuildDivided(jobs.front(), settings, arguments.part, arguments.json);
  // The output must not depend on how many files a pattern happens to match.
  if (arguments.inputs.size() > 1 || isInputPattern(arguments.inputs.front()) || jobs.size() > 1 ||
      arguments.input.all_times || arguments.input.all_channels)
    return runBuildBatch(jobs, settings, arguments.json);
  const BuiltVolume built = buildOne(jobs.front(), settings);
  if (arguments.json)
    printJson(jsonOfBuilt(jobs.front(), built, settings));
  else
    printBuilt(built, settings);
  return 0;
}

// A power of two within [least, most].
auto powerOfTwo(std::int64_t least, std::int64_t most) {
  return [least, most](const std::string& text) {
    const std::int64_t value = parseInteger(text, least, most);
    if ((value & (value - 1)) != 0)
      throw std::invalid_argument(fmt::format("'{}' is not a power of two", text));
    return value;
  };
}

void addOutputOptions(CLI::App& sub, BuildArguments& arguments) {
  beginGroup(sub, kOutputGroup);
  const auto notEmpty = [](const std::string& text) {
    if (text.empty()) throw std::invalid_argument("the name is empty");
    return text;
  };
  CLI::Option* const output = addParsedOption(
      sub, "-o,--output", arguments.output, notEmpty, "OUT.isb",
      "Output; of a single input; default: the input's name with .isb in the current "
      "folder. OUT.isbs is a folder of many files, one for each super-brick, and an index. "
      "{channel}, {time} and {name} are filled for --select channel=all or time=all, and of "
      "several "
      "inputs");
  addParsedOption(sub, "--out-dir", arguments.out_dir, notEmpty, "DIR",
                  "Folder for the pyramids, made if it is missing; default: the current folder")
      ->excludes(output);
  addParsedOption(
      sub, "--part", arguments.part, parseShare, "I/N",
      "Do share I of N shares, I from 1: some super-bricks of an output of many files (OUT.isbs, "
      "a folder), in any order and on any machine; what is there stays");
  // For the commands that take volumes (tools/volume_input.h).
  addParsedOption(sub, "--into-cache", arguments.settings.cache_folder, notEmpty, "DIR", "")
      ->group(kProgramGroup);
  addParsedOption(sub, "--cache-most", arguments.settings.most_cached_bytes, parseByteSize, "SIZE",
                  "")
      ->group(kProgramGroup);
  sub.add_flag("--only-facts", arguments.settings.only_facts, "")->group(kProgramGroup);
  sub.add_flag("--rebuild", arguments.settings.rebuild, "Build also what is up to date");
  addForceFlag(sub, arguments.settings.force)
      ->description(
          "Replace what has the name of the output, also if it is no pyramid of the same input; "
          "never an input");
  CLI::Option* const resume =
      sub.add_flag("--resume", arguments.settings.options.resume,
                   "Go on where an interrupted or killed build with the same options ended");
  sub.add_flag("--index", arguments.settings.index,
               "Write an index: the finest level stays in the input, which is needed then as it is "
               "now, and the rest takes a seventh of the bytes. Of inputs that are read in boxes: "
               "OME-Zarr, also behind a URL, raw files, NRRD, TIFF and VTI without packing, VDB")
      ->excludes(resume);
  addJsonFlag(sub, arguments.json);
  sub.add_flag("--verbose", arguments.settings.verbose, "Say how long each phase took, too");
  beginGroup(sub, kProgramGroup);
  sub.add_flag_callback(
      "--progress-lines", [&] { arguments.settings.progress = ProgressStyle::kLines; },
      "Write how far it is on stderr as lines, for programs: progress 0.612 bricks");
  PreviewOptions& preview = arguments.settings.options.preview;
  addParsedOption(
      sub, "--preview-folder", preview.folder, notEmpty, "DIR",
      "Write a coarse pyramid of what was read by then there, now and then, and a line: "
      "preview STEP X Y Z PATH (every STEP-th of X x Y x Z voxels); all go in the end");
  addParsedOption(
      sub, "--preview-share", preview.most_share, numberFrom(0), "S",
      fmt::format("Share of a build's time that previews may take; 0: none are made; 1: one after "
                  "every slab of bricks; default: {}",
                  preview.most_share));
}

void addResourceOptions(CLI::App& sub, BuildArguments& arguments) {
  beginGroup(sub, kResourceGroup);
  BuildOptions& options = arguments.settings.options;
  options.memory_bytes = kDefaultMemoryBytes;
  addMemoryOption(sub, options.memory_bytes);
  addThreadsOption(sub, arguments.settings.threads);
}

void addPyramidOptions(CLI::App& sub, BuildArguments& arguments) {
  beginGroup(sub, kPyramidGroup);
  BuildOptions& options = arguments.settings.options;
  addStoredOptions(sub, options);
  addParsedOption(
      sub, "--super-brick", arguments.super_cells, powerOfTwo(4, 16384), "CELLS",
      fmt::format("Cells along an edge of a super-brick, a power of two, of an output of "
                  "many files; default: {}",
                  kDefaultSuperCells));
  Choices<format::Filter> filters;
  for (const auto filter : {format::Filter::kAverage, format::Filter::kSubsample})
    filters.emplace_back(filterName(filter), filter);
  addChoiceOption(sub, "--filter", options.filter, filters, "F",
                  "How coarser levels are made: average (default) or subsample");
  addParsedOption(sub, "--brick", options.brick_cells, powerOfTwo(4, 256), "N",
                  "Cells per brick and axis, a power of two from 4 to 256; default: 64");
  addParsedOption(sub, "--tile", options.tile_cells, powerOfTwo(2, 256), "N",
                  "Cells per tile (smallest block with a value range), a power of two; default: 4");
  addParsedOption(
      sub, "--curvature-epsilon", options.curvature_epsilon, numberFrom(0), "E",
      "Samples with a gradient below E x the range of their block do not count for the curvature; "
      "default: 1/64");
  addParsedOption(sub, "--nan-as", options.nan_as, parseSingle, "V",
                  "Value to put where voxels are NaN or infinite; without it they are refused");
  sub.add_flag("--mask-nan", options.mask_nan, kMaskNanHelp);
}

}  // namespace

Command addBuildCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("build", kBuildDescription);
  const auto arguments = std::make_shared<BuildArguments>();
  addOutputOptions(*sub, *arguments);
  addResourceOptions(*sub, *arguments);
  addPyramidOptions(*sub, *arguments);
  beginGroup(*sub, kInputGroup);
  addInputOptions(*sub, arguments->inputs, arguments->input);
  sub->footer(R"(
A pyramid of the same input and options is up to date and is left as it is; one of an input that
changed, or of other options, is built again. An input that fails does not stop the others; the exit
status is 1 then.

Example:
  isobrick build 'scans/*.nrrd' --out-dir pyramids
  isobrick build run.ome.zarr --select channel=all --select time=all -o 'run-{channel}-{time}.isb'
A scan of many machines, each with its part, and then the index (copies of an input need its times, too):
  isobrick build scan.ome.zarr -o scan.isbs --part 3/8
  isobrick merge scan.isbs)");
  return {sub, [arguments] { return runBuild(*arguments); }};
}

}  // namespace isobrick
