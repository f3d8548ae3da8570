// isobrick build: a volume in, a pyramid out.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <new>
#include <optional>
#include <string>

#include "preprocess/pyramid_builder.h"
#include "storage/error.h"
#include "storage/pyramid.h"
#include "tools/byte_size.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/open_input.h"
#include "tools/parse_text.h"
#include "tools/parsed_option.h"
#include "tools/progress_bar.h"
#include "tools/stopwatch.h"
#include "tools/thread_count.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

struct BuildArguments {
  InputOptions input;
  std::string output;
  int threads = allCores();
  bool no_curvature = false;
  std::string filter = "average";
  std::int64_t brick_cells = 64;
  std::int64_t tile_cells = 4;
  double curvature_epsilon = BuildOptions{}.curvature_epsilon;
  std::optional<double> nan_as;
  bool force = false;
  bool json = false;
};

struct BuildResult {
  VolumeInfo volume;
  BuildReport report;
  PyramidBytes bytes;
  int levels = 0;
  double open_seconds = 0;
  double seconds = 0;

  double megabytesPerSecond() const { return static_cast<double>(bytes.raw) / 1e6 / seconds; }
};

bool isPyramid(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  char magic[sizeof format::kMagic] = {};
  return file.read(magic, sizeof magic) &&
         std::equal(std::begin(magic), std::end(magic), std::begin(format::kMagic));
}

void checkOutput(const BuildArguments& arguments) {
  std::error_code ignored;
  if (fs::equivalent(arguments.input.path, arguments.output, ignored))
    throw Error(fmt::format("'{}' is the input; choose another output with -o", arguments.output));
  // A slip of the pen must not cost a scan: a data file behind a header, a slice of a series.
  if (arguments.force && fs::is_regular_file(arguments.output, ignored) &&
      fs::file_size(arguments.output, ignored) > 0 && !isPyramid(arguments.output))
    throw Error(
        fmt::format("'{}' is not a pyramid, and --force replaces only pyramids; choose another "
                    "output with -o",
                    arguments.output));
  if (!arguments.force && fs::is_regular_file(fs::symlink_status(arguments.output, ignored)))
    throw Error(
        fmt::format("'{}' exists already; replace it with --force or choose another "
                    "output with -o",
                    arguments.output));
}

BuildOptions makeBuildOptions(const BuildArguments& arguments, ProgressBar& bar) {
  BuildOptions options;
  options.brick_cells = arguments.brick_cells;
  options.tile_cells = arguments.tile_cells;
  options.filter =
      arguments.filter == "average" ? format::Filter::kAverage : format::Filter::kSubsample;
  options.with_curvature = !arguments.no_curvature;
  options.curvature_epsilon = arguments.curvature_epsilon;
  if (arguments.nan_as) options.nan_as = static_cast<float>(*arguments.nan_as);
  options.tool_version = ISOBRICK_VERSION;
  options.cancel = &interruptFlag();
  options.progress = [&bar](std::string_view phase, double share) { bar.show(phase, share); };
  return options;
}

std::uint64_t rawBytes(const VolumeInfo& info) {
  return static_cast<std::uint64_t>(elementCount(info.voxels)) * voxelBytes(info.voxel_type);
}

BuildReport buildOrExplain(VolumeSource& source, const BuildArguments& arguments) {
  const VolumeInfo& info = source.info();
  const std::uint64_t bytes = rawBytes(info);
  ProgressBar bar(static_cast<double>(bytes) / 1e6, "MB");
  const auto outOfMemory = [&] {
    return Error(
        fmt::format("not enough memory for '{}': its {} x {} x {} voxels take {}, and "
                    "building takes about 1.2 times that; free some memory or check the "
                    "dimensions",
                    info.source, info.voxels.x, info.voxels.y, info.voxels.z, byteSizeText(bytes)));
  };
  try {
    return buildPyramid(source, arguments.output, makeBuildOptions(arguments, bar));
  } catch (const std::bad_alloc&) {
    throw outOfMemory();
  } catch (const std::length_error&) {  // what a vector throws for more than all addresses
    throw outOfMemory();
  }
}

BuildResult build(const BuildArguments& arguments) {
  BuildResult result;
  const Stopwatch total;
  const std::unique_ptr<VolumeSource> source = openInput(arguments.input);
  result.open_seconds = total.seconds();
  result.report = buildOrExplain(*source, arguments);
  result.seconds = total.seconds();
  result.volume = source->info();
  const Pyramid pyramid(arguments.output);
  result.bytes = pyramid.bytes();
  result.levels = pyramid.lattice().levels();
  if (result.report.replaced_voxels > 0)
    result.volume.notes.push_back(fmt::format("{} voxels that were not finite became {}",
                                              result.report.replaced_voxels, *arguments.nan_as));
  return result;
}

Json jsonOfResult(const BuildArguments& arguments, const BuildResult& result) {
  Json json;
  json["output"] = arguments.output;
  json["dimensions"] = jsonOf(result.volume.voxels);
  json["voxel_type"] = voxelTypeName(result.volume.voxel_type);
  json["levels"] = result.levels;
  json["seconds"]["total"] = result.seconds;
  json["seconds"]["open"] = result.open_seconds;
  for (const BuildPhase& phase : result.report.phases) json["seconds"][phase.name] = phase.seconds;
  json["bytes"] = {{"total", result.bytes.total},
                   {"raw", result.bytes.raw},
                   {"samples_level0", result.bytes.samples_level0},
                   {"aprons_level0", result.bytes.aprons_level0},
                   {"samples_coarser", result.bytes.samples_coarser},
                   {"ranges", result.bytes.ranges},
                   {"curvature", result.bytes.curvature},
                   {"index", result.bytes.index}};
  json["notes"] = result.volume.notes;
  json["threads"] = arguments.threads;
  json["peak_rss_bytes"] = peakResidentBytes();
  json["megabytes_per_second"] = result.megabytesPerSecond();
  return json;
}

void printSummary(const BuildArguments& arguments, const BuildResult& result) {
  const Index3& voxels = result.volume.voxels;
  fmt::print("{}: {} x {} x {} {}, {} levels, {} ({:.2f} x raw)\n", arguments.output, voxels.x,
             voxels.y, voxels.z, voxelTypeName(result.volume.voxel_type), result.levels,
             byteSizeText(result.bytes.total),
             static_cast<double>(result.bytes.total) / static_cast<double>(result.bytes.raw));
  for (const std::string& note : result.volume.notes) fmt::print("note: {}\n", note);
  std::string phases = fmt::format("open {:.2f}", result.open_seconds);
  for (const BuildPhase& phase : result.report.phases)
    phases += fmt::format(", {} {:.2f}", phase.name, phase.seconds);
  fmt::print("{:.2f} s ({}); {:.0f} MB/s; {} threads; peak memory {}\n", result.seconds, phases,
             result.megabytesPerSecond(), arguments.threads, byteSizeText(peakResidentBytes()));
}

int runBuild(BuildArguments& arguments) {
  if (arguments.tile_cells > arguments.brick_cells)
    throw UsageError("--tile is larger than --brick; a brick is made of tiles");
  refuseKnownMisfits(arguments.input);
  if (arguments.output.empty()) arguments.output = defaultOutputName(arguments.input.path);
  checkOutput(arguments);
  const BuildResult result = runWithThreads(arguments.threads, [&] { return build(arguments); });
  if (arguments.json)
    printJson(jsonOfResult(arguments, result));
  else
    printSummary(arguments, result);
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

}  // namespace

Command addBuildCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("build", "Make a pyramid (.isb) of a volume");
  const auto arguments = std::make_shared<BuildArguments>();
  addInputOptions(*sub, arguments->input);
  sub->add_option("-o,--output", arguments->output,
                  "Pyramid to write; default: the input's name with .isb in the current folder")
      ->type_name("OUT.isb");
  sub->add_flag("--force", arguments->force, "Replace an existing pyramid");
  addThreadsOption(*sub, arguments->threads);
  sub->add_flag("--no-curvature", arguments->no_curvature,
                "Leave out what extract needs for --curvature; builds faster");
  sub->add_option("--filter", arguments->filter,
                  "How coarser levels are made: average (default) or subsample")
      ->type_name("F")
      ->check(CLI::IsMember({"average", "subsample"}));
  addParsedOption(*sub, "--brick", arguments->brick_cells, powerOfTwo(4, 256), "N",
                  "Cells per brick and axis, a power of two from 4 to 256; default: 64");
  addParsedOption(*sub, "--tile", arguments->tile_cells, powerOfTwo(2, 256), "N",
                  "Cells per tile (smallest block with a value range), a power of two; default: 4");
  addParsedOption(
      *sub, "--curvature-epsilon", arguments->curvature_epsilon,
      [](const std::string& text) { return parseNumberFrom(text, 0); }, "E",
      "Samples with a gradient below E x the range of their tile do not count for the curvature; "
      "default: 1/64");
  addParsedOption(*sub, "--nan-as", arguments->nan_as, parseSingle, "V",
                  "Value to put where voxels are NaN or infinite; without it they are refused");
  sub->add_flag("--json", arguments->json, "Print one JSON object instead of the summary");
  return {sub, [arguments] { return runBuild(*arguments); }};
}

}  // namespace isobrick
