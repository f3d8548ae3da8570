#include "isobrick/preprocess/pyramid_builder.h"

#include <tbb/task_arena.h>

#include <bit>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <new>
#include <string>
#include <vector>

#include "isobrick/preprocess/finite_voxels.h"
#include "isobrick/preprocess/hand_over.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/level_maker.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/preview_maker.h"
#include "isobrick/preprocess/pyramid_file_builder.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_writer.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

struct UnfinishedBuild {
  const VolumeInfo& info;
  const BuildOptions& options;
  InputWatch& input;
  PyramidWriter& writer;
  std::uint64_t bricks = 0;  // of the whole pyramid
};

enum class InputState { kAsItWas, kChanged, kUnknown };

// Unknown if the user cancelled the check.
InputState stateOf(InputWatch& input) {
  try {
    input.checkContent();
    return InputState::kAsItWas;
  } catch (const Cancelled&) {
    return InputState::kUnknown;
  } catch (const Error&) {
    return InputState::kChanged;
  }
}

bool keepForResume(const UnfinishedBuild& build) {
  PyramidWriter& writer = build.writer;
  // An index has no samples to go on from.
  if (!build.options.keep_unfinished || !build.options.source_record.empty() ||
      writer.bricksWritten() == 0)
    return false;
  try {
    writer.flush();
  } catch (const Error&) {  // the disk is full: the last bricks are made again
  }
  writer.keepForResume();
  return true;
}

std::string whatIsKept(const UnfinishedBuild& build) {
  const auto percent = static_cast<int>(100 * static_cast<double>(build.writer.bricksWritten()) /
                                        static_cast<double>(build.bricks));
  return concat(percent, " % of the bricks are kept in '", build.writer.temporaryPath(), "'");
}

[[noreturn]] void throwInterrupted(const UnfinishedBuild& build) {
  if (!keepForResume(build)) throw Cancelled();
  throw Cancelled("interrupted; " + whatIsKept(build), {.path = build.writer.temporaryPath()},
                  {Remedy::kResume});
}

// The same error, of a build that can go on.
ResumableError resumable(const UnfinishedBuild& build, const Error& error,
                         const std::string& more = "") {
  std::vector<Remedy> remedies = error.remedies();
  remedies.push_back(Remedy::kResume);
  return ResumableError(error.what() + more + "; " + whatIsKept(build), error.place(), remedies);
}

// For a catch block: throws the current exception as the caller of buildPyramid() gets it. If the
// build can be resumed, the temporary file stays, and the message says so.
void throwUnfinished(const UnfinishedBuild& build) {
  try {
    throw;
  } catch (const Cancelled&) {
    throwInterrupted(build);
  } catch (const ResumableError& error) {
    if (!keepForResume(build)) throw;
    throw resumable(build, error);
  } catch (const Error& error) {
    // A file that is written or moved while it is read may look damaged.
    const InputState state = stateOf(build.input);
    if (state == InputState::kUnknown) throwInterrupted(build);
    if (state == InputState::kAsItWas || !keepForResume(build)) throw;
    throw resumable(build, error, "; it changed while it was read");
  } catch (const std::bad_alloc&) {
    if (!keepForResume(build)) throw;
    const std::string& source = build.info.source;
    throw resumable(
        build, fileError(source, "not enough memory for '", source, "'", Remedy::kUseLessMemory));
  }
}

std::string spaceText(std::uint64_t bytes) {
  return bytes < std::uint64_t{1} << 20 ? std::to_string((bytes + 1023) >> 10) + " KiB"
                                        : std::to_string(bytes >> 20) + " MiB";
}

// One build of a pyramid, or of a super-brick of it; T is the voxel type.
template <typename T>
class Build : LevelInput<T> {
 public:
  Build(VolumeSource& source, InputWatch& input, const std::string& path,
        const BuildOptions& options, const std::optional<DividedFile>& file,
        const std::string& provenance)
      : source_(source),
        input_(input),
        options_(options),
        folder_(folderOf(path)),
        spec_(pyramidSpecOf(source.info(), options)),
        not_finite_{storedNanAs(options, spec_.values), options.mask_nan},
        file_(file),
        provenance_(provenance),
        region_(spec_, file_),
        previews_(makePreviews(source.info(), options)),
        plan_(makePlan()),
        identity_(buildIdentity(source.info(), input.identity(), options)),
        writer_(path, spec_, identity_, options.resume, options.cancel, file_),
        closures_(region_.layout(), region_.rows(), spec_.has_missing),
        levels_(spec_, region_, plan_, options, folder_, writer_, closures_, statistics_, times_) {}

  BuildReport run() {
    const auto begin = PhaseTimes::Clock::now();
    try {
      takeSpace();
      publish(levels_.run(this, nullptr));
    } catch (...) {
      throwUnfinished({source_.info(), options_, input_, writer_, region_.rows().count()});
    }
    for (std::size_t step = 0; step < kBuildStepNames.size(); ++step)
      report_.phases.push_back(
          {kBuildStepNames[step], times_.seconds(static_cast<BuildStep>(step))});
    report_.seconds = std::chrono::duration<double>(PhaseTimes::Clock::now() - begin).count();
    report_.bricks = writer_.bricksWritten();
    report_.bricks_resumed = writer_.bricksResumed();
    return std::move(report_);
  }

 private:
  static std::optional<float> storedNanAs(const BuildOptions& options,
                                          const ValueTransform& values) {
    if (!options.nan_as) return std::nullopt;
    return static_cast<float>(values.stored(static_cast<double>(*options.nan_as)));
  }

  static std::unique_ptr<PreviewMaker<T>> makePreviews(const VolumeInfo& info,
                                                       const BuildOptions& options) {
    constexpr std::uint64_t kLeastShare = 4;  // of the memory is for the build itself
    if (options.preview.folder.empty() || options.super_cells > 0 || options.mask_nan ||
        options.memory_bytes < kLeastShare * kPreviewBytes)
      return nullptr;
    const std::optional<PreviewGrid> grid = previewGridOf(info.voxels);
    return grid ? std::make_unique<PreviewMaker<T>>(info, *grid, options) : nullptr;
  }

  // Rather no previews than no pyramid.
  BuildPlan makePlan() {
    const int threads = tbb::this_task_arena::max_concurrency();
    if (previews_ != nullptr) {
      try {
        return makeBuildPlan(spec_, region_, &source_, options_.memory_bytes - kPreviewBytes,
                             threads);
      } catch (const Error&) {
        previews_.reset();
      }
    }
    return makeBuildPlan(spec_, region_, &source_, options_.memory_bytes, threads);
  }

  // A full disk is to show now rather than at the end. The size of packed bricks is unknown
  // beforehand: then only space that cannot be enough is refused.
  void takeSpace() {
    const std::optional<std::uint64_t> free_bytes = writer_.freeBytes();
    if (!free_bytes) return;
    const std::uint64_t have = *free_bytes + writer_.bytesWritten();
    const std::uint64_t most = plan_.file_bytes_bound;
    constexpr std::uint64_t kMostPacking = 16;
    const bool is_packed = options_.codec != format::Codec::kStored;
    const std::uint64_t least = plan_.scratch_file_bytes + (is_packed ? most / kMostPacking : most);
    if (have < least)
      throw ResumableError("not enough space for '" + writer_.temporaryPath() + "': it takes " +
                               (is_packed ? "at least " : "up to ") + spaceText(least) +
                               " and the disk has " + spaceText(have) +
                               "; free some space, or choose another folder" +
                               (is_packed ? "" : ", or pack it"),
                           {.path = writer_.temporaryPath()},
                           is_packed ? std::vector{Remedy::kOtherFolder}
                                     : std::vector{Remedy::kOtherFolder, Remedy::kPack});
    if (have >= most + plan_.scratch_file_bytes) writer_.reserve(most);
  }

  // ---- LevelInput: the reading thread

  void begin(std::int64_t first_slice) override {
    // For sources that are read in order; reading begins where an earlier build ended.
    if (source_.readsBoxes()) return;
    spool_ = std::make_unique<SliceSpool>(source_, first_slice, plan_.spool_slices,
                                          plan_.spool_place, folder_, options_.cancel);
  }
  void releaseBefore(std::int64_t slice) override {
    if (spool_ != nullptr) spool_->releaseBefore(slice);
  }
  void announce(std::span<const IndexBox> boxes) override {
    if (spool_ == nullptr) source_.announce(boxes);
  }
  void read(const IndexBox& slices, std::byte* to) override {
    if (spool_ != nullptr)
      spool_->read(slices, to);
    else
      source_.readBox(slices, to);
  }
  void check(const IndexBox& box, std::byte* voxels, const IndexBox& own) override {
    // Before its bricks come to the journal: a brick of other content must never be resumed.
    input_.check();
    if constexpr (std::is_same_v<T, float>)
      makeFinite(reinterpret_cast<float*>(voxels), box, own, not_finite_, source_.info(), counts_);
  }
  // The calling thread.
  void passedOn(const IndexBox& bricks, const HandedOn<T>& handed_on) override {
    if (previews_ == nullptr) return;
    previews_->include(handed_on.box, handed_on.samples);
    const Index3 all = region_.layout().bricks(0);
    const bool ends_slab = bricks.end().x == all.x && bricks.end().y == all.y;
    if (ends_slab) previews_->offer(handed_on.box.end().z);
  }

  // `passed_on` is what the last level did; null at the top of the pyramid.
  void publish(const std::unique_ptr<LevelStore>& passed_on) {
    spool_.reset();
    const PhaseTimes::Timer timer(times_, BuildStep::kPublish);
    input_.checkContent();
    if (options_.cancel != nullptr) options_.cancel->check();
    report_.replaced_voxels = counts_.replaced;
    report_.missing_voxels = counts_.missing;
    report_.has_curvature = writer_.hasCurvature();
    if (counts_.missing == static_cast<std::uint64_t>(elementCount(spec_.voxels)))
      throw fileError(source_.info().source, "'", source_.info().source,
                      "' has no voxel with data: all are NaN");
    PyramidWriter::Summary summary;
    summary.missing_voxels = counts_.missing;
    summary.voxel_range = levels_.voxelRange();
    summary.brick_ranges = closures_.all();
    summary.provenance_json =
        provenance_.empty() ? provenanceText(source_, options_, identity_, counts_) : provenance_;
    if (file_) {
      summary.division = handOverOf({options_.codec, summary.voxel_range}, *passed_on, statistics_);
    } else {
      summary.histogram = statistics_.histogram(spec_.voxel_type, summary.voxel_range);
      summary.noise = statistics_.noise();
      summary.gradients =
          statistics_.gradients(*summary.histogram, summary.voxel_range, spec_.voxels);
    }
    report_.file_bytes = writer_.finish(summary, options_.codec);
  }

  VolumeSource& source_;
  InputWatch& input_;  // by the reading thread, and by the caller's once that has ended
  const BuildOptions& options_;
  std::string folder_;  // of the output
  const PyramidSpec spec_;
  const NotFinite not_finite_;             // with values as they are stored
  const std::optional<DividedFile> file_;  // of a divided pyramid
  const std::string provenance_;           // empty: that of this build
  const BuildRegion region_;
  std::unique_ptr<PreviewMaker<T>> previews_;  // null: none are made
  const BuildPlan plan_;
  const std::string identity_;
  PyramidWriter writer_;
  PhaseTimes times_;
  BrickClosures closures_;
  VoxelStatistics statistics_;
  LevelMaker<T> levels_;
  std::unique_ptr<SliceSpool> spool_;  // of a source that is read in order
  NotFiniteCounts counts_;
  BuildReport report_;
};

// The temporary files are emptied and removed.
void refuseInputAsTemporary(const VolumeSource& source, const std::string& path) {
  for (const std::string& file : source.files())
    for (const char* ending : {"", ".partial", ".partial.journal", ".partial.journal.new"}) {
      if (isSameFile(file, path + ending))
        throw fileError(file, "'", file, "' is an input, and building '", path,
                        "' would overwrite it; choose another output");
    }
}

void checkOptions(const BuildOptions& options) {
  if (options.resume && !options.source_record.empty())
    throw Error("an index is built in one go; begin anew", {}, {Remedy::kBeginAnew});
  if (options.nan_as.has_value() && !std::isfinite(*options.nan_as))
    throw Error("the value that replaces NaN and infinite voxels must itself be finite");
  if (options.mask_nan && options.super_cells > 0)
    throw Error(
        "voxels without data are kept by pyramids of one file alone; build one, or put a value "
        "there",
        {}, {Remedy::kReplaceNotFinite});
  const auto isPowerOfTwo = [](std::int64_t n) {
    return n > 0 && std::has_single_bit(static_cast<std::uint64_t>(n));
  };
  if (!isPowerOfTwo(options.brick_cells) || options.brick_cells < 4 || options.brick_cells > 256 ||
      !isPowerOfTwo(options.tile_cells) || options.tile_cells < 2 ||
      options.tile_cells > options.brick_cells)
    throw Error("a brick has 4 to 256 cells an axis and a tile 2 up to the brick's, powers of two");
  if (options.with_curvature &&
      !(options.curvature_epsilon >= 0 && std::isfinite(options.curvature_epsilon)))
    throw Error("the least gradient that counts for the curvature must be finite, 0 or more");
}

}  // namespace

std::string noteOfNoCurvature() {
  return "no curvature is stored, since there is nothing to gain: surfaces of level 1 are nowhere "
         "within half a voxel of those of level 0";
}

BuildReport buildPyramid(VolumeSource& source, const std::string& path,
                         const BuildOptions& options) {
  InputWatch input(source, options.cancel);
  return buildPyramid(source, input, path, options);
}

BuildReport buildPyramid(VolumeSource& source, InputWatch& input, const std::string& path,
                         const BuildOptions& options) {
  if (options.super_cells != 0)
    throw Error("'" + path + "' would be a file of a divided pyramid; build its super-bricks");
  return buildPyramidFile(source, input, path, options, std::nullopt);
}

BuildReport buildPyramidFile(VolumeSource& source, InputWatch& input, const std::string& path,
                             const BuildOptions& options, const std::optional<DividedFile>& file,
                             const std::string& provenance) {
  checkOptions(options);
  refuseInputAsTemporary(source, path);
  source.chooseVoxels(options.cancel, [&](double fraction) {
    if (options.progress) options.progress("values", fraction);
  });
  return visitVoxelType(source.info().voxel_type, [&](auto tag) {
    return Build<typename decltype(tag)::Type>(source, input, path, options, file, provenance)
        .run();
  });
}

PyramidSpec pyramidSpecOf(const VolumeInfo& info, const BuildOptions& options) {
  PyramidSpec spec;
  spec.voxels = info.voxels;
  spec.voxel_type = info.voxel_type;
  spec.geometry = info.geometry;
  spec.values = info.values;
  spec.filter = options.filter;
  spec.brick_cells = options.brick_cells;
  spec.tile_cells = options.tile_cells;
  spec.has_curvature = options.with_curvature;
  spec.curvature_epsilon = options.curvature_epsilon;
  spec.has_missing = options.mask_nan && info.voxel_type == VoxelType::kFloat32;
  if (!options.source_record.empty())
    spec.level0 = isRemotePath(info.source) ? Level0Place::kBehindUrl : Level0Place::kInFiles;
  return spec;
}

BuildOptions buildOptionsOf(const PyramidSpec& spec) {
  BuildOptions options;
  options.filter = spec.filter;
  options.brick_cells = spec.brick_cells;
  options.tile_cells = spec.tile_cells;
  options.with_curvature = spec.has_curvature;
  options.curvature_epsilon = spec.curvature_epsilon;
  options.mask_nan = spec.has_missing;
  if (spec.level0 != Level0Place::kStored) options.source_record = "{}";
  return options;
}

}  // namespace isobrick
