// isobrick convert: volumes and pyramids in, volumes of other formats out.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/deviation_code.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote_options.h"
#include "tools/build/build_batch.h"
#include "tools/build/build_one.h"
#include "tools/build/build_report.h"
#include "tools/build/open_input.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/outputs.h"
#include "tools/parse_text.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// `pattern`: of the slices in it, or empty.
bool holdsNothingElse(const std::string& folder, const std::string& pattern) {
  if (pattern.empty()) return isZarrFolder(folder);
  const auto slices = parseNumberedName(pattern);
  return slices && holdsNothingBut(folder, [&](const FolderMember& entry) {
           return entry.isRegularFile() && slices->matches(entry.name());
         });
}

// "scan.h5" for "scan.h5:/entry/data".
std::string fileOf(const std::string& name) {
  return isHdf5Name(name) ? splitHdf5Name(name).first : name;
}

// The rule of tools/outputs.h for all that convert writes: files, and folders of slices or of
// OME-Zarr, which are replaced with `force` if nothing else is in them. `inputs`: the names that
// the user gave, and all their files.
void refuseConvertOutput(const std::string& output, const std::vector<std::string>& inputs,
                         bool force) {
  std::vector<std::string> files;
  std::transform(inputs.begin(), inputs.end(), std::back_inserter(files), fileOf);
  const fs::path path(fileOf(output));
  const std::string name = path.filename().string();
  const bool has_slices = name.find('%') != std::string::npos && path.has_parent_path();
  const std::string place = has_slices ? path.parent_path().string() : path.string();
  if (isFolder(place))
    refuseReplacingFolder({place}, files, force, [&](const std::string& folder) {
      return holdsNothingElse(folder, has_slices ? name : "");
    });
  else
    refuseReplacingVolume({place}, files, force);
}

struct ConvertArguments {
  InputOptions input;
  std::string output;
  int level = 0;
  bool all_levels = false;
  std::optional<Corners> box;
  std::optional<ValueWindow> window;
  std::string type;
  BuildOptions build;   // of an .isb
  ExportOptions write;  // of all else
  bool with_ranges = false, with_curvature = false;
  bool no_map = false;
  std::string cache_folder;
  std::uint64_t cache_bytes = 0;
  bool force = false;
  bool json = false;
  int threads = allCores();
};

bool hasEnding(const std::string& path, const char* ending) {
  return fs::path(path).extension() == ending;
}

bool isPyramid(const std::string& path) { return hasEnding(path, ".isb") || isPyramidFile(path); }

// In voxel indices of level 0, as the box was given; before any of its numbers becomes an integer.
void refuseBoxBeyond(const Corners& corners, const VolumeInfo& info, int level) {
  const glm::dvec3 last = glm::dvec3(info.voxels - Index3(1)) * std::ldexp(1.0, level);
  for (int axis = 0; axis < 3; ++axis)
    if (!(corners.lower[axis] >= 0 && corners.upper[axis] <= last[axis]))
      throw Error(fmt::format("the box of --box is not within '{}', whose voxels are 0,0,0 to "
                              "{},{},{}; choose a box within",
                              info.source, last.x, last.y, last.z),
                  {.path = info.source});
}

// Both corners are in the box; of a coarser level, the samples that lie in it.
IndexBox boxOfLevel(const Corners& corners, int level) {
  IndexBox box;
  const double step = static_cast<double>(std::int64_t{1} << level);
  for (int axis = 0; axis < 3; ++axis) {
    box.first[axis] = static_cast<std::int64_t>(std::ceil(corners.lower[axis] / step));
    box.count[axis] =
        static_cast<std::int64_t>(std::floor(corners.upper[axis] / step)) + 1 - box.first[axis];
  }
  return box;
}

std::unique_ptr<VolumeSource> withViews(std::unique_ptr<VolumeSource> source,
                                        const ConvertArguments& arguments, int level) {
  if (arguments.box) {
    refuseBoxBeyond(*arguments.box, source->info(), level);
    source = makeCroppedSource(std::move(source), boxOfLevel(*arguments.box, level));
  }
  if (arguments.window)
    return makeWindowedSource(std::move(source), *arguments.window,
                              *voxelTypeNamed(arguments.type));
  const VolumeInfo& info = source->info();
  if (arguments.type == "f32" &&
      !(info.voxel_type == VoxelType::kFloat32 && info.values.isIdentity()))
    return makeFloatSource(std::move(source));
  return source;
}

struct Opened {
  VolumeLevels levels, nodes;
};

// What the pyramid stores of the nodes of the levels from `first` to `last`.
VolumeLevels openNodes(const ConvertArguments& arguments,
                       const std::shared_ptr<const Pyramid>& pyramid, int first, int last) {
  VolumeLevels nodes;
  const IndexBox voxels = arguments.box ? boxOfLevel(*arguments.box, 0)
                                        : IndexBox{Index3(0), pyramid->lattice().voxels()};
  const auto add = [&](NodeValue value, int level) {
    nodes.push_back(
        makeNodeSource(pyramid, pyramid->budgetBytes(), value, level, voxels, &interruptFlag()));
  };
  for (int level = first; arguments.with_ranges && level <= last; ++level)
    for (const NodeValue value : {NodeValue::kLeast, NodeValue::kGreatest}) add(value, level);
  if (arguments.with_curvature)
    for (int i = 0; i < kDeviationCoefficients; ++i)
      add(static_cast<NodeValue>(static_cast<int>(NodeValue::kCurvature) + i), 0);
  return nodes;
}

Opened openLevels(const ConvertArguments& arguments) {
  const std::uint64_t memory_bytes = arguments.build.memory_bytes / 2;
  Opened opened;
  VolumeLevels& levels = opened.levels;
  if (isPyramid(arguments.input.path)) {
    const OpenOptions options = openOptionsOf(arguments.input);
    refuseUnusablePath(arguments.input.path, options);
    const auto pyramid =
        openPyramidFile(arguments.input.path, memory_bytes, fileAccess(arguments.no_map),
                        remoteOptions(arguments.cache_folder, arguments.cache_bytes));
    const bool all = arguments.all_levels;
    const int first = all ? 0 : arguments.level;
    const int last = all ? pyramid->lattice().levels() - 1 : arguments.level;
    for (int level = first; level <= last; ++level) {
      // A box of a coarse level may have a single sample along an axis: no volume any more.
      if (level > first && arguments.box) {
        const Index3 count = boxOfLevel(*arguments.box, level).count;
        if (std::min({count.x, count.y, count.z}) < 2) break;
      }
      levels.push_back(
          withViews(viewAsGiven(makePyramidSource(pyramid, memory_bytes, level, &interruptFlag()),
                                options, level),
                    arguments, level));
    }
    opened.nodes =
        openNodes(arguments, pyramid, first, first + static_cast<int>(levels.size()) - 1);
  } else {
    const std::vector<InputOptions> inputs = inputsOfGrids(arguments.input);
    for (const InputOptions& input : inputs) {
      levels.push_back(
          withViews(openShowingProgress(input, memory_bytes / inputs.size()), arguments, 0));
      if (inputs.size() > 1 && levels.back()->info().format != "OpenVDB")
        throw UsageError(fmt::format("several grids are of a .vdb, and '{}' is none; choose one",
                                     arguments.input.path));
    }
  }
  return opened;
}

struct Converted {
  VolumeInfo volume;  // of the finest level
  VolumeWriteReport report;
  std::size_t levels = 1;
  double seconds = 0;
};

Converted convert(const ConvertArguments& arguments) {
  const Stopwatch watch;
  std::vector<std::string> inputs{arguments.input.path};
  refuseConvertOutput(arguments.output, inputs, arguments.force);
  auto [levels, nodes] = openLevels(arguments);
  VolumeSource& source = *levels.front();
  refuseUnfitInputOptions(*arguments.input.parser, source.info());
  for (const std::string& file : source.files()) inputs.push_back(file);
  refuseConvertOutput(arguments.output, inputs, arguments.force);
  InputWatch input(source, &interruptFlag());

  Converted converted;
  converted.volume = source.info();
  converted.levels = levels.size();
  std::move(nodes.begin(), nodes.end(), std::back_inserter(levels));
  if (isPyramid(arguments.output)) {
    converted.report.bytes =
        buildShowingProgress(source, input, arguments.output, arguments.build).file_bytes;
    converted.volume = source.info();
    converted.report.space = "LPS";
  } else {
    ProgressBar bar(static_cast<double>(volumeBytes(source.info())) / 1e6, "MB");
    ExportOptions options = arguments.write;
    options.cancel = &interruptFlag();
    options.progress = [&](double share) { bar.show("convert", share); };
    options.memory_bytes = arguments.build.memory_bytes;
    options.before_publishing = [&] { input.checkContent(); };
    std::uint64_t held = source.bufferBytes();
    // Levels of a pyramid have one pager.
    for (std::size_t i = 1; i < converted.levels && !isPyramid(arguments.input.path); ++i)
      held += levels[i]->bufferBytes();
    constexpr std::uint64_t kLeast = std::uint64_t{8} << 20;
    if (held > options.memory_bytes || options.memory_bytes - held < kLeast)
      throw Error(fmt::format("'{}' takes {} to be read, and {} more to be written",
                              arguments.input.path, byteSizeText(held), byteSizeText(kLeast)),
                  {.path = arguments.input.path}, {Remedy::kAllowMoreMemory});
    options.memory_bytes -= held;
    converted.report = exportVolume(levels, arguments.output, options);
    converted.volume.voxel_type = levels.front()->info().voxel_type;
  }
  // A writer may have put another source in its place.
  for (std::string& note : levels.front()->notesOfReading())
    converted.volume.notes.push_back(std::move(note));
  converted.seconds = watch.seconds();
  return converted;
}

Json jsonOfConverted(const ConvertArguments& arguments, const Converted& converted) {
  const VolumeInfo& volume = converted.volume;
  Json json = Json::object();
  json["input"] = withoutSecrets(arguments.input.path);
  json["output"] = arguments.output;
  json["format"] = volume.format;
  putGrid(volume.voxels, volume.voxel_type, volume.geometry, json);
  json["levels"] = converted.levels;
  json["space"] = converted.report.space;
  json["notes"] = volume.notes;
  json["lost"] = converted.report.lost;
  json["bytes"] = converted.report.bytes;
  json["seconds"] = converted.seconds;
  json["threads"] = arguments.threads;
  json["peak_rss_bytes"] = peakResidentBytes();
  return json;
}

void printConverted(const ConvertArguments& arguments, const Converted& converted) {
  const VolumeInfo& volume = converted.volume;
  fmt::print(
      "{}: {}x{}x{} {} voxels{}, world in {}, unit of length {}; {} in {:.2f} s, {:.0f} MB/s\n",
      oneLine(arguments.output), volume.voxels.x, volume.voxels.y, volume.voxels.z,
      voxelTypeName(volume.voxel_type),
      converted.levels > 1 ? fmt::format(" in {} {}", converted.levels,
                                         arguments.input.grids.empty() ? "levels" : "grids")
                           : "",
      converted.report.space, lengthUnitName(volume.geometry.unit),
      byteSizeText(converted.report.bytes), converted.seconds,
      static_cast<double>(volumeBytes(volume)) / 1e6 / std::max(converted.seconds, 1e-9));
  for (const std::string& note : volume.notes) fmt::print("note: {}\n", oneLine(note));
}

void checkUsage(const ConvertArguments& arguments) {
  refuseKnownMisfits(inputsOfGrids(arguments.input).front());
  if (!isPyramid(arguments.output)) refuseUnknownExport(arguments.output, false);
  if (const std::size_t grids = inputsOfGrids(arguments.input).size(); grids > 1) {
    if (!hasEnding(arguments.output, ".vdb"))
      throw UsageError(
          fmt::format("{} grids go into one .vdb; choose one for other formats, with "
                      "--select grid=NAME",
                      grids));
    if (arguments.box)
      throw UsageError("--box is of one grid, and several have voxels of their own; choose one");
  }
  refuseUnfitOutputOptions(*arguments.input.parser, arguments.output);
  for (const char* const option : {"--zarr-shard", "--part"})
    if (arguments.write.zarr_version == 2 &&
        findOption(*arguments.input.parser, option)->count() > 0)
      throw UsageError(
          fmt::format("Zarr 2 has no shards; leave out {} or --zarr-version 2", option));
  if ((arguments.with_ranges || arguments.with_curvature) &&
      (arguments.window || arguments.input.spacing || arguments.input.origin ||
       !arguments.input.unit.empty()))
    throw UsageError(
        "--with-ranges and --with-curvature write what the pyramid stores, in its place; leave out "
        "--window, --spacing, --origin and --input-unit");
  if (!arguments.input.derivation.isNone() && (arguments.level > 0 || arguments.all_levels))
    throw UsageError(
        "--label and --denoise are of the finest level; leave out --level and --all-levels");
  if (arguments.window && (arguments.type.empty() || arguments.type == "f32"))
    throw UsageError("--window needs the type that its values are spread over: --type u8");
  if (!arguments.window && !arguments.type.empty() && arguments.type != "f32")
    throw UsageError(
        "--type makes integers of the values within --window LO,HI; give it, or --type f32");
}

// One, or one for each file of a sequence, whose number is that of its output.
std::vector<ConvertArguments> conversionsOf(const ConvertArguments& arguments) {
  const auto files = filesOfSequence(arguments.input.path);
  if (files.empty()) return {arguments};
  const std::optional<NumberedName> name = parseNumberedName(arguments.output);
  if (!name)
    throw UsageError(
        fmt::format("'{}' names {} files; the output's name needs a place for their "
                    "numbers, too: out.%04d.vdb",
                    arguments.input.path, files.size()));
  std::vector<ConvertArguments> conversions;
  for (const auto& [number, path] : files) {
    conversions.push_back(arguments);
    conversions.back().input.path = path;
    conversions.back().output = name->of(number);
  }
  return conversions;
}

int runConvert(const ConvertArguments& arguments) {
  Json all = Json::array();
  const std::vector<ConvertArguments> conversions = conversionsOf(arguments);
  for (const ConvertArguments& one : conversions) {
    checkUsage(one);
    const Converted converted = runWithThreads(one.threads, [&] { return convert(one); });
    if (one.json)
      all.push_back(jsonOfConverted(one, converted));
    else
      printConverted(one, converted);
    warnOfLosses(one.output, converted.report.lost);
  }
  if (arguments.json)
    printJson(conversions.front().input.path == arguments.input.path ? all.front()
                                                                     : Json{{"volumes", all}});
  return 0;
}

// "LO,HI"
ValueWindow parseWindow(const std::string& text) {
  const std::size_t comma = text.find(',');
  if (comma == std::string::npos)
    throw std::invalid_argument(fmt::format("'{}' is not LO,HI: two numbers", text));
  const ValueWindow window{parseNumber(text.substr(0, comma)), parseNumber(text.substr(comma + 1))};
  if (!(window.low < window.high))
    throw std::invalid_argument(fmt::format("'{}': the lower value comes first", text));
  return window;
}

void addVdbOptions(CLI::App& app, ExportOptions& options) {
  addParsedOption(
      app, "--vdb-background", options.vdb_background, parseSingle, "V",
      "Value of what a .vdb does not store; default: that of the .vdb it came from, or 0");
  const auto parseTolerance = [](const std::string& text) {
    parseSingle(text);
    return parseNumberFrom(text, 0);
  };
  addParsedOption(
      app, "--vdb-tolerance", options.vdb_tolerance, parseTolerance, "T",
      "Voxels no further than T from the background are not stored in a .vdb; default: 0");
  app.add_flag("--half", options.vdb_half, "Half floats in a .vdb");
  app.add_option("--vdb-codec", options.vdb_codec,
                 "How the values of a .vdb are packed: blosc, zip (neither level sets nor fog) or "
                 "none; default: blosc, if OpenVDB has it")
      ->type_name("C")
      ->check(CLI::IsMember({"blosc", "zip", "none"}));
}

void addZarrOptions(CLI::App& app, ExportOptions& options) {
  app.add_option("--zarr-version", options.zarr_version,
                 "Of Zarr, for .ome.zarr: 3 for OME-Zarr 0.5, with shards; 2 for OME-Zarr 0.4, a "
                 "file for each chunk of 64 voxels an axis; default: 3")
      ->type_name("N")
      ->check(CLI::IsMember({2, 3}));
  const auto parseShard = [](const std::string& text) {
    const std::int64_t voxels = integerWithin(64, 4096)(text);
    if (voxels % 64 != 0)
      throw std::invalid_argument(
          fmt::format("'{}' is no multiple of 64, the voxels of a chunk "
                      "along an axis",
                      text));
    return voxels;
  };
  addParsedOption(app, "--zarr-shard", options.zarr_shard, parseShard, "VOXELS",
                  "Voxels of a shard along each axis, for .ome.zarr of version 3: a multiple of "
                  "64; default: 512");
  addParsedOption(app, "--part", options.zarr_part, parseShare, "I/N",
                  "Write share I of N of the shards, I from 1, into a folder beside the .ome.zarr, "
                  "in any order and on any machine; the run that finds all N there joins them");
}

}  // namespace

Command addConvertCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("convert", kConvertDescription);
  const auto arguments = std::make_shared<ConvertArguments>();
  arguments->build.memory_bytes = kDefaultMemoryBytes;
  arguments->build.keep_unfinished = false;  // there is no --resume
  sub->add_option(
         "IN", arguments->input.path,
         "Pyramid (.isb), also behind a URL; or a volume in any format that `build` reads, "
         "OME-Zarr also behind a URL; a sequence, in.%04d.vdb, becomes out.%04d.vdb")
      ->type_name("PATH")
      ->required();
  beginGroup(*sub, kOutputGroup);
  sub->add_option("-o,--output", arguments->output,
                  "Output; the ending says the format: .isb, .nrrd, .mhd, .mha, .nii, "
                  ".nii.gz, .vti, .vdb, .ome.zarr, .h5 (or file.h5:/path), .tif, .raw, or "
                  "slices: folder/%04d.exr, folder/%04d.tif")
      ->type_name("OUT")
      ->required();
  CLI::Option* const level = addLevelOption(*sub, arguments->level, 20);
  sub->add_flag("--all-levels", arguments->all_levels, "Of a pyramid, all levels (.vdb, .ome.zarr)")
      ->excludes(level);
  addBoxOption(*sub, arguments->box);
  addParsedOption(*sub, "--window", arguments->window, parseWindow, "LO,HI",
                  "Spread the values from LO to HI over all of the integers of --type; what lies "
                  "outside becomes the nearest of them");
  sub->add_option("--type", arguments->type,
                  "Voxels to write; u8, i8, u16 or i16 of a --window, or f32; default: as they are")
      ->type_name("T")
      ->check(CLI::IsMember({"u8", "i8", "u16", "i16", "f32"}));
  addVdbOptions(*sub, arguments->write);
  addZarrOptions(*sub, arguments->write);
  sub->add_flag("--with-ranges", arguments->with_ranges,
                "Of a pyramid, beside each level in a .vdb the least and the greatest value of "
                "every tile: grids min, max, min_level1, ...");
  sub->add_flag("--with-curvature", arguments->with_curvature,
                "Of a pyramid, in a .vdb the curvature bounds of all blocks of level 0: grids "
                "curvature_0 to curvature_7");
  sub->add_flag(
      "--lossy", arguments->write.is_lossy,
      "Write values in a type that changes them by more than a thousandth of their range");
  beginGroup(*sub, kPyramidGroup);
  addStoredOptions(*sub, arguments->build);
  beginGroup(*sub, kOutputGroup);
  addForceFlag(*sub, arguments->force);
  beginGroup(*sub, kResourceGroup);
  addMemoryOption(*sub, arguments->build.memory_bytes);
  addNoMapFlag(*sub, arguments->no_map);
  addThreadsOption(*sub, arguments->threads);
  addCacheFolderOption(*sub, arguments->cache_folder)->group(kRemoteGroup);
  addCacheSizeOption(*sub, arguments->cache_bytes);
  beginGroup(*sub, kOutputGroup);
  addJsonFlag(*sub, arguments->json);
  beginGroup(*sub, kInputGroup);
  addOpenOptions(*sub, arguments->input);
  sub->footer(R"(
World coordinates are taken as LPS (DICOM, ITK), lengths as millimetres if the input says its unit;
the summary says in which space and unit the output is. A warning names everything that its format
cannot keep, a line each. docs/FORMATS.md has the table.

Example:
  isobrick convert head.isb --level 1 -o half.nii.gz)");
  return {sub, [arguments] {
            if (isPyramid(arguments->input.path)) arguments->input.pyramid_level = arguments->level;
            arguments->input.keep_numbers = !isPyramid(arguments->output);
            return runConvert(*arguments);
          }};
}

}  // namespace isobrick
