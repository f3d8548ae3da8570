#include "tools/build/build_one.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <new>
#include <stdexcept>
#include <system_error>

#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/preview_maker.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/indexed_source.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/pyramid_tables.h"
#include "isobrick/storage/pyramid_writer.h"
#include "tools/build/build_report.h"
#include "tools/build/open_input.h"
#include "tools/interrupt.h"
#include "tools/outputs.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/pyramid_cache.h"
#include "tools/shared_options.h"
#include "tools/volume_input.h"

namespace isobrick {
namespace {

// Level 0 comes first, and only its bricks are read from the input.
std::uint64_t freshBytes(const BrickLayout& layout, std::uint64_t raw, std::uint64_t resumed) {
  const auto all = static_cast<std::uint64_t>(elementCount(layout.bricks(0)));
  const double share = static_cast<double>(all - std::min(all, resumed)) / static_cast<double>(all);
  return static_cast<std::uint64_t>(static_cast<double>(raw) * share);
}

// The pyramid has its name by now: if there is no memory left to open it, returns the facts known
// without it, and the build has not failed. Numbers of an input that was not read have its type.
PyramidBytes bytesOfPyramid(BuiltVolume& built) {
  try {
    const Pyramid pyramid(built.output);
    built.volume.voxel_type = pyramid.spec().voxel_type;
    return pyramid.sums().bytes;
  } catch (const std::bad_alloc&) {
    PyramidBytes bytes;
    bytes.total = fileBytes(built.output);
    bytes.raw = volumeBytes(built.volume);
    return bytes;
  }
}

void takeNoteOfPyramid(const BuildOptions& options, BuiltVolume& built) {
  built.bytes = bytesOfPyramid(built);
  const BrickLayout layout(Lattice(built.volume.voxels), options.brick_cells, options.tile_cells);
  built.levels = layout.lattice().levels();
  built.bricks = 0;
  for (int level = 0; level < built.levels; ++level)
    built.bricks += static_cast<std::uint64_t>(elementCount(layout.bricks(level)));
  if (!built.skipped)
    built.fresh_bytes = freshBytes(layout, built.bytes.raw, built.report.bricks_resumed);
}

// Before a pyramid of a volume of so many bytes comes into the cache, which may lie in a home
// folder with a quota.
void warnOfFullCache(const std::string& folder, std::uint64_t bytes) {
  const auto warn = [&](const std::string& what) {
    fmt::print(stderr,
               "{}the cache in '{}' {}; choose another folder with XDG_CACHE_HOME, bound it "
               "with ISOBRICK_CACHE_SIZE, or empty it ('isobrick cache')\n",
               kWarningWord, oneLine(folder), what);
  };
  std::uint64_t held = bytes;
  for (const CachedPyramid& entry : listCache(folder)) held += entry.bytes;
  held = std::min(held, std::max(bytes, cacheBound()));
  const DiskSpace disk = diskSpaceAt(folder).value_or(DiskSpace{});
  const std::uint64_t free = disk.free - std::min(disk.free, bytes);
  if (free < disk.capacity / 10)
    warn(fmt::format("leaves {} of the disk's {} free with this pyramid", byteSizeText(free),
                     byteSizeText(disk.capacity)));
  else if (held > kManyCachedBytes && std::getenv("ISOBRICK_CACHE_SIZE") == nullptr)
    warn(fmt::format("takes up to {} with this pyramid", byteSizeText(held)));
}

// The place of a pyramid in the cache: one that is up to date beside the input is taken as it is;
// else the file is named after its identity, and the lock keeps other processes from building it.
std::unique_ptr<CacheBuildLock> placeInCache(BuildJob& job, const BuildSettings& settings,
                                             const VolumeInfo& info,
                                             const std::string& input_identity) {
  const std::filesystem::path folder = std::filesystem::path(job.input.path).parent_path();
  const auto isThere = [&] {
    return isUpToDate(job.output, info, input_identity, settings.options, true);
  };
  job.output = (folder / defaultOutputName(job.input.path)).string();
  if (isThere()) return nullptr;
  job.output =
      pathInCache(settings.cache_folder, buildIdentity(info, input_identity, settings.options));
  if (settings.only_facts) return nullptr;
  makeCacheFolder(settings.cache_folder);
  auto lock = std::make_unique<CacheBuildLock>(job.output, interruptFlag());
  if (settings.most_cached_bytes > 0 && volumeBytes(info) > settings.most_cached_bytes &&
      !isThere())
    throw tooLargeForCache(job.input.path, volumeBytes(info));
  if (!isThere()) warnOfFullCache(settings.cache_folder, volumeBytes(info));
  return lock;
}

// In the cache nobody says whether to go on: a build that was begun of another content, or
// differently, cannot be.
BuildReport buildOrBeginAnew(VolumeSource& source, InputWatch& input, const BuildJob& job,
                             const BuildSettings& settings, const ShownAs& shown) {
  BuildOptions options = settings.options;
  if (!settings.cache_folder.empty()) {
    try {
      options.resume = true;
      return buildShowingProgress(source, input, job.output, options, shown);
    } catch (const ResumableError&) {
      throw;
    } catch (const Error& failure) {
      const auto& remedies = failure.remedies();
      if (std::find(remedies.begin(), remedies.end(), Remedy::kBeginAnew) == remedies.end()) throw;
      options.resume = false;
    }
  }
  return buildShowingProgress(source, input, job.output, options, shown);
}

void tellOfPreview(const BuildPreview& preview) {
  const Index3& voxels = preview.voxels;
  fmt::print(stderr, "preview {} {} {} {} {}\n", preview.step, voxels.x, voxels.y, voxels.z,
             preview.path);
}

// How many voxels a sample of a coarser level stands for, the same along each axis, a power of two;
// 0: there is no such number. A level may have one sample more, at the end of the volume.
std::int64_t stepOf(const Index3& samples, const Index3& voxels) {
  std::int64_t step = 2;
  while (voxels.x / step > samples.x) step *= 2;
  for (int axis = 0; axis < 3; ++axis)
    if (samples[axis] < 2 || samples[axis] < voxels[axis] / step ||
        samples[axis] > voxels[axis] / step + 1)
      return 0;
  return step;
}

// The preview of a store with coarser levels of its own is one of them, at once, in place of those
// that a build makes as it reads. If it fails there are these. Its file goes with it.
class StorePreview {
 public:
  // If it is there, `preview` asks for no others.
  StorePreview(const InputOptions& input, const VolumeInfo& info, PreviewOptions& preview) {
    OpenOptions options = openOptionsOf(input);
    const auto grid = previewGridOf(info.voxels);
    if (preview.folder.empty() || !(preview.most_share > 0.0) || info.format != "OME-Zarr" ||
        options.spacing || !options.derivation.isNone() || !grid)
      return;
    try {
      options.store_level =
          static_cast<std::size_t>(std::countr_zero(static_cast<std::uint64_t>(grid->step)));
      options.cancel = &interruptFlag();
      options.memory_bytes = kPreviewBytes;
      const std::unique_ptr<VolumeSource> source = openVolume(input.path, options);
      const std::int64_t step = stepOf(source->info().voxels, info.voxels);
      if (step == 0 || elementCount(source->info().voxels) > kMostVoxels) return;
      path_ = (std::filesystem::path(preview.folder) / "level.isb").string();
      BuildOptions build = previewBuildOptions();
      build.tool_version = ISOBRICK_VERSION;
      build.cancel = &interruptFlag();
      buildPyramid(*source, path_, build);
      tellOfPreview({path_, step, info.voxels});
      preview.folder.clear();
    } catch (const std::exception&) {  // the build itself fails, if it must, by itself
    }
  }
  ~StorePreview() {
    if (!path_.empty()) removeName(path_);
  }
  StorePreview(const StorePreview&) = delete;
  StorePreview& operator=(const StorePreview&) = delete;

 private:
  static constexpr std::int64_t kMostVoxels = std::int64_t{1} << 24;  // more take too long

  std::string path_;
};

// An existing file is in the way, unless it is a pyramid, whose origin isUpToDate() checks.
void refuseAsOutput(const BuildJob& job, const std::vector<std::string>& inputs, bool replace) {
  refuseReplacing({job.output, "choose another output with -o or --out-dir"}, inputs, replace);
}

BuiltVolume openAndBuild(BuildJob job, BuildSettings settings) {
  const Stopwatch watch;
  BuiltVolume built;
  const bool into_cache = !settings.cache_folder.empty();
  const std::uint64_t cache_bytes = into_cache ? cacheBound() : 0;
  if (!into_cache)
    refuseAsOutput(job, {job.input.path}, settings.force || beginsAsPyramid(job.output));
  const ShownAs shown{job.label, settings.progress};
  const std::unique_ptr<VolumeSource> source =
      openShowingProgress(job.input, settings.options.memory_bytes / 2, shown);
  built.open_seconds = watch.seconds();
  refuseUnfitInputOptions(*job.input.parser, source->info());
  settings.options.source_record = recordOfJob(job, settings, *source);
  InputWatch input(*source, &interruptFlag());
  const auto lock =
      into_cache ? placeInCache(job, settings, source->info(), input.identity()) : nullptr;
  built.output = job.output;
  refuseAsOutput(job, source->files(), true);
  const bool is_up_to_date = isUpToDate(job.output, source->info(), input.identity(),
                                        settings.options, settings.force || into_cache);
  if (settings.only_facts && !is_up_to_date) {
    built.output.clear();
    built.facts = factsOfVolume(*source, settings.options);
    return built;
  }
  built.skipped = is_up_to_date && !settings.rebuild;
  const bool goes_on =
      settings.options.resume && isPresent(job.output + std::string(kUnfinishedEnding));
  if (built.skipped) {
    removeStrayJournal(job.output);
  } else {
    const StorePreview preview(job.input, source->info(), settings.options.preview);
    built.report = buildOrBeginAnew(*source, input, job, settings, shown);
  }
  if (lock && !built.skipped) trimCache(settings.cache_folder, cache_bytes, job.output);
  built.volume = source->info();
  for (std::string& note : source->notesOfReading()) built.volume.notes.push_back(std::move(note));
  if (goes_on && !built.skipped && built.report.bricks_resumed == 0)
    built.volume.notes.push_back("no brick of the earlier run was whole: all are made anew");
  if (built.report.replaced_voxels > 0)
    built.volume.notes.push_back(fmt::format("{} voxels that were not finite became {}",
                                             built.report.replaced_voxels,
                                             *settings.options.nan_as));
  if (built.report.missing_voxels > 0)
    built.volume.notes.push_back(noteOfMissing(built.report.missing_voxels));
  if (settings.options.with_curvature && !built.report.has_curvature && !built.skipped)
    built.volume.notes.push_back(noteOfNoCurvature());
  takeNoteOfPyramid(settings.options, built);
  built.seconds = watch.seconds();
  return built;
}

Error outOfMemory(const BuildJob& job, const BuildSettings& settings) {
  return Error(
      fmt::format("not enough memory for '{}': the system gives less than the {} that --memory "
                  "allows; give a smaller --memory or fewer --threads",
                  job.input.path, byteSizeText(settings.options.memory_bytes)));
}

}  // namespace

std::string recordOfJob(const BuildJob& job, const BuildSettings& settings,
                        const VolumeSource& source) {
  if (!settings.index) return {};
  return sourceRecord(source, openOptionsOf(job.input), job.output);
}

std::unique_ptr<VolumeSource> openShowingProgress(const InputOptions& input,
                                                  std::uint64_t memory_bytes,
                                                  const ShownAs& shown) {
  ProgressBar bar(100, "%", shown.style);
  OpenOptions options = openOptionsOf(input);
  options.cancel = &interruptFlag();
  options.memory_bytes = memory_bytes;
  options.progress = [&](std::string_view phase, double share) {
    bar.show(shown.label + std::string(phase), share);
  };
  if (const auto phantom = phantomOf(input.path))
    return viewAsGiven(makePhantomSource(*phantom), options);
  try {
    return openVolume(input.path, options);
  } catch (const SeveralSeries& refusal) {
    if (shown.style == ProgressStyle::kLines)
      for (const auto& [name, text] : refusal.series)
        fmt::print(stderr, "choice series={} {}\n", oneLine(name), oneLine(text));
    throw;
  }
}

BuildReport buildShowingProgress(VolumeSource& source, InputWatch& input, const std::string& output,
                                 BuildOptions options, const ShownAs& shown) {
  ProgressBar bar(static_cast<double>(volumeBytes(source.info())) / 1e6, "MB", shown.style);
  return buildPyramid(source, input, output, showingProgress(std::move(options), shown, bar));
}

BuildOptions showingProgress(BuildOptions options, const ShownAs& shown, ProgressBar& bar) {
  options.tool_version = ISOBRICK_VERSION;
  options.cancel = &interruptFlag();
  options.progress = [&](std::string_view phase, double share) {
    bar.show(shown.label + std::string(phase), share);
  };
  options.preview.published = tellOfPreview;
  return options;
}

BuiltVolume buildOne(const BuildJob& job, const BuildSettings& settings) {
  BuiltVolume built;
  buildWithThreads(job, settings, [&] { built = openAndBuild(job, settings); });
  return built;
}

void buildWithThreads(const BuildJob& job, const BuildSettings& settings,
                      const std::function<void()>& build) {
  refuseKnownMisfits(job.input);
  try {
    runWithThreads(settings.threads, build);
  } catch (const std::bad_alloc&) {
    throw outOfMemory(job, settings);
  } catch (const std::length_error&) {  // a vector throws it for more than all addresses
    throw outOfMemory(job, settings);
  } catch (const std::system_error& failure) {  // a thread that the system does not give
    if (failure.code() != std::errc::resource_unavailable_try_again) throw;
    throw Error(fmt::format("cannot start the threads to build '{}': {}; give fewer --threads",
                            job.input.path, failure.what()));
  }
}

namespace {

namespace fs = std::filesystem;

// The provenance of a pyramid; empty if it has none.
struct Origin {
  std::string source, identity;
};

// The file may be hostile: text that is no JSON, or nested too deep, gives nothing.
Origin originOf(const PyramidTables& pyramid) {
  const nlohmann::json json = parseShallowJson(pyramid.provenance());
  return {textOf(member(json, "source")), textOf(member(json, "identity"))};
}

// The first line of an identity: the files' sizes, times and content, without any option.
std::string inputLine(const std::string& identity) {
  return identity.substr(0, identity.find('\n'));
}

// A relative path names another file in another folder, and a pyramid does not store the folder in
// which it was built. One that lies in the current folder, or below it, was most likely built from
// here.
bool meansTheSameFile(const std::string& source, const std::string& output) {
  if (fs::path(source).is_absolute()) return true;
  const fs::path from_here = canonicalPath(output).lexically_relative(canonicalPath("."));
  return !from_here.empty() && *from_here.begin() != "..";
}

}  // namespace

bool isUpToDate(const std::string& output, const VolumeInfo& info,
                const std::string& input_identity, const BuildOptions& options, bool force) {
  if (!isRegularFile(output)) return false;
  const auto inTheWay = [&](const std::string& why) {
    if (!force)
      throw Error(fmt::format("'{}' exists and {}; replace it with --force, or choose another "
                              "output with -o or --out-dir",
                              output, why),
                  {.path = output});
    return false;
  };
  Origin origin;
  try {
    origin = originOf(PyramidTables(output, FileAccess::kRead, {}));
  } catch (const Error& error) {
    return inTheWay(fmt::format("from what it was made is unknown ({})", error.what()));
  }
  const std::string identity = buildIdentity(info, input_identity, options);
  if (origin.identity == identity) return true;
  if (inputLine(origin.identity) == inputLine(identity)) return false;
  if (origin.source != info.source)
    return inTheWay(fmt::format("was made from '{}'", origin.source));
  if (!meansTheSameFile(origin.source, output))
    return inTheWay(fmt::format("was made from another '{}', or from this one before it changed",
                                origin.source));
  return false;
}

}  // namespace isobrick
