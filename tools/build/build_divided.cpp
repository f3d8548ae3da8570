#include "tools/build/build_divided.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <filesystem>

#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/preprocess/super_brick_input.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/pyramid_writer.h"
#include "tools/build/build_report.h"
#include "tools/build/open_input.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/outputs.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// What became of a share.
struct DividedResult {
  std::size_t all = 0, in_share = 0, built = 0, up_to_date = 0;
  std::uint64_t bricks = 0, resumed = 0, replaced_voxels = 0, file_bytes = 0, raw_bytes = 0;
  double seconds = 0;
  std::optional<JoinReport> join;
};

// Any process may make the folder first.
void makeFolder(const std::string& folder) {
  if (mkdir(folder.c_str(), 0777) == 0) syncFolderOf(folder);
  if (isPresent(folder) && !isFolder(folder))
    throw Error(
        fmt::format("'{}' is a file, and a pyramid of many files is a folder; choose another "
                    "output with -o",
                    folder),
        {.path = folder});
  if (!isFolder(folder))
    throw Error(fmt::format("cannot make the folder '{}'; create the folder above it, or choose "
                            "another output with -o",
                            folder),
                {.path = folder});
}

JoinReport joinShowingProgress(const std::string& folder, const BuildSettings& settings) {
  ProgressBar bar(100, "%", settings.progress);
  JoinOptions options;
  options.memory_bytes = settings.options.memory_bytes;
  options.cancel = &interruptFlag();
  options.progress = [&](std::string_view phase, double share) { bar.show(phase, share); };
  return joinPyramid(folder, options);
}

class DividedBuild {
 public:
  DividedBuild(const BuildJob& job, BuildSettings& settings)
      : job_(job),
        settings_(settings),
        volume_([this] { return open(); }, job.output),
        watch_(volume_.volume(), &interruptFlag()) {
    refuseUnfitInputOptions(*job.input.parser, volume());
    settings.options.source_record = recordOfJob(job, settings, volume_.volume());
    files_ = superBrickFiles(volume(), settings.options);
    identity_ = buildIdentity(volume(), watch_.identity(), settings.options);
    const std::string index = (fs::path(job.output) / kIndexName).string();
    refuseOther(index, stateOfDividedFile(index, identity_));
    result_.all = files_.size();
  }

  void build(const ShareNumber& share) {
    const NumberRun run = runOfShare(files_.size(), share);
    result_.in_share = run.count;
    makeFolder(job_.output);
    for (std::size_t i = 0; i < run.count; ++i) {
      interruptFlag().check();
      buildNext(run.first + i, run.first + run.count,
                fmt::format("[{}/{}] {}  ", i + 1, run.count, files_[run.first + i].name));
    }
  }
  DividedResult& result() { return result_; }

 private:
  const VolumeInfo& volume() const { return volume_.volume().info(); }

  // Files of two builds in one folder are no pyramid.
  void refuseOther(const std::string& path, DividedFileState state) const {
    if (settings_.force || state != DividedFileState::kOfAnotherBuild) return;
    throw Error(fmt::format("'{}' exists and was built of another input, or with other options; "
                            "replace it with --force, or choose another output with -o",
                            path),
                {.path = path});
  }

  std::unique_ptr<VolumeSource> open() const {
    return openShowingProgress(job_.input, settings_.options.memory_bytes / 2,
                               {job_.label, settings_.progress});
  }

  // The state of the file; one that may not be replaced ends the build.
  DividedFileState stateOf(std::size_t number) const {
    const std::string path = (fs::path(job_.output) / files_[number].name).string();
    refuseReplacing({path}, volume_.volume().files(), true);
    const DividedFileState state = stateOfDividedFile(path, identity_);
    refuseOther(path, state);
    return state;
  }
  bool isMissing(std::size_t number) const {
    return stateOf(number) != DividedFileState::kBuilt || settings_.rebuild;
  }

  // The missing ones of [number, end) that lie beside it: the first slices are read for all.
  std::vector<SuperBrickFile> neighboursOf(std::size_t number, std::size_t end) const {
    std::vector<SuperBrickFile> missing = {files_[number]};
    while (++number < end && files_[number].voxels.first.z == missing.front().voxels.first.z)
      if (isMissing(number)) missing.push_back(files_[number]);
    return missing;
  }

  void buildNext(std::size_t number, std::size_t end, const std::string& label) {
    if (!isMissing(number)) {
      removeStrayJournal((fs::path(job_.output) / files_[number].name).string());
      ++result_.up_to_date;
      return;
    }
    const ShownAs shown{label, settings_.progress};
    const std::uint64_t raw =
        static_cast<std::uint64_t>(files_[number].voxels.size()) * voxelBytes(volume().voxel_type);
    ProgressBar bar(static_cast<double>(raw) / 1e6, "MB", settings_.progress);
    const BuildOptions options = showingProgress(settings_.options, shown, bar);
    VolumeSource& source =
        volume_.sourceOf(neighboursOf(number, end), &interruptFlag(),
                         [&](double share) { options.progress("reading slices", share); });
    const BuildReport report = buildSuperBrick(source, watch_, job_.output, number, options);
    ++result_.built;
    result_.bricks += report.bricks;
    result_.resumed += report.bricks_resumed;
    result_.replaced_voxels += report.replaced_voxels;
    result_.file_bytes += report.file_bytes;
    result_.raw_bytes += raw;
  }

  const BuildJob& job_;
  const BuildSettings& settings_;
  SuperBrickInput volume_;
  InputWatch watch_;
  std::string identity_;
  std::vector<SuperBrickFile> files_;
  DividedResult result_;
};

Json jsonOfJoin(const JoinReport& join) {
  return {{"super_bricks", join.super_bricks}, {"bricks", join.bricks},
          {"index_bytes", join.index_bytes},   {"file_bytes", join.file_bytes},
          {"corrections", join.corrections},   {"seconds", join.seconds}};
}

void printJoin(const std::string& folder, const JoinReport& join) {
  fmt::print("{}: joined {} files, {} in all; index {} ({:.3f} % of them), {:.2f} s\n", folder,
             join.super_bricks, byteSizeText(join.file_bytes), byteSizeText(join.index_bytes),
             100 * static_cast<double>(join.index_bytes) / static_cast<double>(join.file_bytes),
             join.seconds);
}

void printResult(const BuildJob& job, const BuildSettings& settings, const DividedResult& result,
                 const std::optional<ShareNumber>& share, bool json) {
  if (json) {
    Json object = Json::object();
    object["input"] = job.input.path;
    object["output"] = job.output;
    if (share) object["part"] = {{"number", share->number}, {"of", share->of}};
    object["super_bricks"] = {{"all", result.all},
                              {"in_part", result.in_share},
                              {"built", result.built},
                              {"up_to_date", result.up_to_date}};
    object["super_brick_cells"] = settings.options.super_cells;
    object["bricks"] = result.bricks;
    object["bricks_resumed"] = result.resumed;
    object["replaced_voxels"] = result.replaced_voxels;
    object["codec"] = codecOptionName(settings.options.codec);
    object["raw_bytes"] = result.raw_bytes;
    object["file_bytes"] = result.file_bytes;
    object["join"] = result.join ? jsonOfJoin(*result.join) : Json(nullptr);
    object["seconds"] = result.seconds;
    object["threads"] = settings.threads;
    object["peak_rss_bytes"] = peakResidentBytes();
    return printJson(object);
  }
  fmt::print("{}: {} of {} super-bricks of {} cells: {} built, {} up to date\n", job.output,
             result.in_share, result.all, settings.options.super_cells, result.built,
             result.up_to_date);
  if (result.replaced_voxels > 0)
    fmt::print("note: {} voxels that were not finite were replaced\n", result.replaced_voxels);
  if (result.resumed > 0 || (settings.options.resume && result.built > 0))
    fmt::print("resumed: {} of {} bricks are of an earlier run\n", result.resumed, result.bricks);
  if (result.join) printJoin(job.output, *result.join);
  const double rate =
      result.seconds > 0 ? static_cast<double>(result.raw_bytes) / 1e6 / result.seconds : 0;
  fmt::print("{:.2f} s; {:.0f} MB/s; {} threads; peak memory {}, --memory {}\n", result.seconds,
             rate, settings.threads, byteSizeText(peakResidentBytes()),
             byteSizeText(settings.options.memory_bytes));
}

}  // namespace

int runBuildDivided(const BuildJob& job, BuildSettings settings,
                    const std::optional<ShareNumber>& share, bool json) {
  const Stopwatch watch;
  DividedResult result;
  buildWithThreads(job, settings, [&] {
    DividedBuild build(job, settings);
    build.build(share.value_or(ShareNumber()));
    result = build.result();
    if (!share) result.join = joinShowingProgress(job.output, settings);
  });
  result.seconds = watch.seconds();
  printResult(job, settings, result, share, json);
  return 0;
}

namespace {

int joinAndReport(const std::string& folder, std::uint64_t memory_bytes, int threads, bool json) {
  BuildSettings settings;
  settings.options.memory_bytes = memory_bytes;
  const JoinReport join =
      runWithThreads(threads, [&] { return joinShowingProgress(folder, settings); });
  if (json) {
    Json object = {{"output", folder}};
    object["join"] = jsonOfJoin(join);
    printJson(object);
  } else {
    printJoin(folder, join);
  }
  return 0;
}

}  // namespace

PyramidJoin* pyramidJoin() { return joinAndReport; }

}  // namespace isobrick
