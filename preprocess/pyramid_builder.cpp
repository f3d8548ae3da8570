#include "isobrick/preprocess/pyramid_builder.h"

#include <tbb/task_arena.h>

#include <bit>
#include <chrono>
#include <cmath>
#include <filesystem>

#include "isobrick/preprocess/brick_maker.h"
#include "isobrick/preprocess/brick_pipeline.h"
#include "isobrick/preprocess/finite_voxels.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/kernels/curvature_fit.h"
#include "isobrick/preprocess/preview_maker.h"
#include "isobrick/preprocess/slice_spool.h"
#include "isobrick/preprocess/unfinished_build.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

PyramidSpec specOf(const VolumeInfo& info, const BuildOptions& options) {
  PyramidSpec spec;
  spec.voxels = info.voxels;
  spec.voxel_type = info.voxel_type;
  spec.geometry = info.geometry;
  spec.filter = options.filter;
  spec.brick_cells = options.brick_cells;
  spec.tile_cells = options.tile_cells;
  spec.has_curvature = options.with_curvature;
  spec.curvature_epsilon = options.curvature_epsilon;
  return spec;
}

std::string spaceText(std::uint64_t bytes) {
  return bytes < std::uint64_t{1} << 20 ? std::to_string((bytes + 1023) >> 10) + " KiB"
                                        : std::to_string(bytes >> 20) + " MiB";
}

// One build; T is the voxel type. The levels come one after the other, each as windows of bricks
// that pass through the pipeline; the samples for the next level wait in a store.
template <typename T>
class Build {
 public:
  Build(VolumeSource& source, InputWatch& input, const std::string& path,
        const BuildOptions& options)
      : source_(source),
        input_(input),
        options_(options),
        folder_(folderOf(path)),
        spec_(specOf(source.info(), options)),
        layout_(spec_.layout()),
        needs_(spec_),
        previews_(makePreviews(source.info(), options)),
        plan_(makePlan()),
        identity_(buildIdentity(source.info(), input.identity(), options)),
        writer_(path, spec_, identity_, options.resume, options.cancel),
        closures_(layout_, TableRows(layout_)),
        maker_(spec_, options.codec, needs_, closures_, statistics_, times_) {}

  BuildReport run() {
    const auto begin = PhaseTimes::Clock::now();
    try {
      takeSpace();
      makeLevels();
      publish();
    } catch (...) {
      throwUnfinished({source_.info(), options_, input_, writer_, closures_.all().size()});
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
  // The samples of a level and the tile ranges of the level below it.
  struct LevelStore {
    ScratchVolume samples, finer_tiles;
  };

  static std::unique_ptr<PreviewMaker<T>> makePreviews(const VolumeInfo& info,
                                                       const BuildOptions& options) {
    constexpr std::uint64_t kLeastShare = 4;  // of the memory is for the build itself
    if (options.preview.folder.empty() || options.memory_bytes < kLeastShare * kPreviewBytes)
      return nullptr;
    const std::optional<PreviewGrid> grid = previewGridOf(info.voxels);
    return grid ? std::make_unique<PreviewMaker<T>>(info, *grid, options) : nullptr;
  }

  // Rather no previews than no pyramid.
  BuildPlan makePlan() {
    const int threads = tbb::this_task_arena::max_concurrency();
    if (previews_ != nullptr) {
      try {
        return makeBuildPlan(spec_, source_, options_.memory_bytes - kPreviewBytes, threads);
      } catch (const Error&) {
        previews_.reset();
      }
    }
    return makeBuildPlan(spec_, source_, options_.memory_bytes, threads);
  }

  void progress(const char* what, double fraction) {
    if (options_.cancel != nullptr) options_.cancel->check();
    if (options_.progress) options_.progress(what, fraction);
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

  void makeLevels() {
    BrickPipeline pipeline(plan_, [this](const BrickBatch& batch) { writeBatch(batch); });
    std::unique_ptr<LevelStore> store;
    for (int level = 0; level < layout_.lattice().levels(); ++level) {
      std::unique_ptr<LevelStore> next = makeStore(level + 1);
      makeLevel(level, store.get(), next.get(), pipeline);
      store = std::move(next);
    }
    pipeline.finish();
  }

  std::unique_ptr<LevelStore> makeStore(int level) const {
    if (level == layout_.lattice().levels()) return nullptr;
    const ScratchVolume::Place place = plan_.stores[static_cast<std::size_t>(level)];
    return std::unique_ptr<LevelStore>(
        new LevelStore{{layout_.lattice().samples(level), sizeof(T), place, folder_},
                       {needs_.allTiles(level - 1) * Index3(2, 1, 1), sizeof(T), place, folder_}});
  }

  void makeLevel(int level, const LevelStore* store, LevelStore* next, BrickPipeline& pipeline) {
    const BuildPlan::WindowShape& shape = plan_.windows[static_cast<std::size_t>(level)];
    const BrickWindows windows(layout_.bricks(level), shape.x, shape.y);
    std::unique_ptr<SliceSpool> spool = level == 0 ? makeSpool(windows) : nullptr;
    LargeBuffer handed_on_samples(plan_.handed_on_bytes);
    pipeline.run(
        windows.count(),
        [&](std::int64_t i, BrickWindow& window) {
          window.bricks = windows.window(i);
          readWindow(level, store, spool.get(), window);
        },
        [&](const BrickWindow& window, BrickBatch& batch) {
          HandedOn<T> handed_on;
          if (next != nullptr) {
            handed_on.box = needs_.handedOn(level, window.bricks);
            handed_on.samples =
                reinterpret_cast<T*>(handed_on_samples.dataFor(bytesOf(handed_on.box)));
            handed_on.tiles = &next->finer_tiles;
          }
          makeBricks(level, window, store, handed_on, batch);
          if (next == nullptr) return;
          next->samples.write(handed_on.box, handed_on.samples);
          if (level == 0 && previews_ != nullptr) preview(window.bricks, handed_on);
        });
  }

  void preview(const IndexBox& bricks, const HandedOn<T>& handed_on) {
    previews_->include(handed_on.box, handed_on.samples);
    const Index3 all = layout_.bricks(0);
    const bool ends_slab = bricks.end().x == all.x && bricks.end().y == all.y;
    if (ends_slab) previews_->offer(handed_on.box.end().z);
  }

  static std::size_t bytesOf(const IndexBox& box) {
    return static_cast<std::size_t>(box.size()) * sizeof(T);
  }

  bool isResumed(int level, const Index3& brick) const {
    return closures_.row(level, brick) < writer_.bricksResumed();
  }

  // For sources that are read in order; reading begins where an earlier build ended.
  std::unique_ptr<SliceSpool> makeSpool(const BrickWindows& windows) {
    if (source_.readsBoxes()) return nullptr;
    for (std::int64_t i = 0; i < windows.count(); ++i) {
      const IndexBox bricks = windows.window(i);
      if (isResumed(0, bricks.end() - Index3(1))) continue;
      return std::make_unique<SliceSpool>(source_, needs_.samples(0, bricks).first.z,
                                          plan_.spool_slices, plan_.spool_place, folder_,
                                          options_.cancel);
    }
    return nullptr;
  }

  void readWindow(int level, const LevelStore* store, SliceSpool* spool, BrickWindow& window) {
    if (options_.cancel != nullptr) options_.cancel->check();
    window.has_samples = !isResumed(level, window.bricks.end() - Index3(1));
    if (!window.has_samples) return;
    const PhaseTimes::Timer timer(times_, BuildStep::kRead);
    window.sample_box = needs_.samples(level, window.bricks);
    std::byte* const samples = window.samples.dataFor(bytesOf(window.sample_box));
    if (spool != nullptr) spool->releaseBefore(window.sample_box.first.z);
    // A window may be large and a disk slow: a request to cancel must not wait for all of it.
    std::byte* to = samples;
    for (const IndexBox& slices : piecesOf(window.sample_box)) {
      if (options_.cancel != nullptr) options_.cancel->check();
      if (level > 0)
        store->samples.read(slices, to);
      else if (spool != nullptr)
        spool->read(slices, to);
      else
        source_.readBox(slices, to);
      to += bytesOf(slices);
    }
    if (level > 0) return;
    // Before its bricks come to the journal: a brick of other content must never be resumed.
    input_.check();
    if constexpr (std::is_same_v<T, float>)
      report_.replaced_voxels += makeFinite(reinterpret_cast<float*>(samples), window.sample_box,
                                            ownVoxels(window), options_.nan_as, source_.info());
  }

  // The box as some slices at a time, of some MiB together.
  static std::vector<IndexBox> piecesOf(const IndexBox& box) {
    constexpr std::int64_t kPieceBytes = std::int64_t{4} << 20;
    const auto slice_bytes = box.count.x * box.count.y * static_cast<std::int64_t>(sizeof(T));
    const std::int64_t most = std::max<std::int64_t>(1, kPieceBytes / slice_bytes);
    std::vector<IndexBox> pieces;
    for (std::int64_t z = 0; z < box.count.z; z += most)
      pieces.push_back({box.first + Index3(0, 0, z),
                        {box.count.x, box.count.y, std::min(most, box.count.z - z)}});
    return pieces;
  }

  // The voxels of a window that no other window counts.
  IndexBox ownVoxels(const BrickWindow& window) const {
    const IndexBox& bricks = window.bricks;
    const Index3 first = bricks.first * spec_.brick_cells + glm::min(bricks.first, Index3(1));
    const Index3 end =
        glm::min(bricks.end() * spec_.brick_cells + Index3(1), window.sample_box.end());
    return {first, end - first};
  }

  void makeBricks(int level, const BrickWindow& window, const LevelStore* store,
                  const HandedOn<T>& handed_on, BrickBatch& batch) {
    const auto samples =
        SampleBlock<T>::dense(reinterpret_cast<const T*>(window.samples.data()), window.sample_box);
    const IndexBox& bricks = window.bricks;
    batch.count = static_cast<std::size_t>(bricks.size());
    const auto brickAt = [&](std::size_t i) {
      const auto n = static_cast<std::int64_t>(i);
      return bricks.first + Index3(n % bricks.count.x, n / bricks.count.x, 0);
    };
    // Resumed bricks come first, for bricks are written in this order.
    batch.first = 0;
    while (batch.first < batch.count && isResumed(level, brickAt(batch.first))) ++batch.first;
    std::vector<ValueRange> voxels(batch.count);
    isolatedForEach(std::size_t{0}, batch.count, [&](std::size_t i) {
      if (options_.cancel != nullptr && options_.cancel->requested()) return;
      const Index3 brick = brickAt(i);
      voxels[i] = i < batch.first ? maker_.remake(level, brick, writer_, handed_on)
                                  : maker_.make(level, brick, samples,
                                                store != nullptr ? &store->finer_tiles : nullptr,
                                                handed_on, batch.bricks[i]);
    });
    for (const ValueRange& range : voxels) voxel_range_.include(range);
    bricks_made_ += batch.count;
    progress("bricks",
             static_cast<double>(bricks_made_) / static_cast<double>(closures_.all().size()));
  }

  void writeBatch(const BrickBatch& batch) {
    const PhaseTimes::Timer timer(times_, BuildStep::kWrite);
    for (std::size_t i = batch.first; i < batch.count; ++i) {
      if (options_.cancel != nullptr) options_.cancel->check();
      writer_.write(batch.bricks[i]);
    }
    writer_.flush();
  }

  void publish() {
    const PhaseTimes::Timer timer(times_, BuildStep::kPublish);
    input_.checkContent();
    if (options_.cancel != nullptr) options_.cancel->check();
    const VoxelHistogram histogram = statistics_.histogram(spec_.voxel_type, voxel_range_);
    report_.file_bytes =
        writer_.finish({voxel_range_, closures_.all(), histogram, statistics_.noise(),
                        provenanceText(source_, options_, identity_),
                        statistics_.gradients(histogram, voxel_range_, spec_.voxels)},
                       options_.codec);
  }

  VolumeSource& source_;
  InputWatch& input_;  // by the reading thread, and by the caller's once that has ended
  const BuildOptions& options_;
  std::string folder_;  // of the output
  const PyramidSpec spec_;
  const BrickLayout layout_;
  const BrickNeeds needs_;
  std::unique_ptr<PreviewMaker<T>> previews_;  // null: none are made
  const BuildPlan plan_;
  const std::string identity_;
  PyramidWriter writer_;
  PhaseTimes times_;
  BrickClosures closures_;
  VoxelStatistics statistics_;
  BrickMaker<T> maker_;
  ValueRange voxel_range_;
  std::size_t bricks_made_ = 0;
  BuildReport report_;
};

// The temporary files are emptied and removed.
void refuseInputAsTemporary(const VolumeSource& source, const std::string& path) {
  for (const std::string& file : source.files())
    for (const char* ending : {"", ".partial", ".partial.journal", ".partial.journal.new"}) {
      std::error_code ignored;
      if (std::filesystem::equivalent(file, path + ending, ignored))
        throw Error("'" + file + "' is an input, and building '" + path +
                        "' would overwrite it; choose another output",
                    {.path = file});
    }
}

void checkOptions(const BuildOptions& options) {
  if (options.nan_as.has_value() && !std::isfinite(*options.nan_as))
    throw Error("the value that replaces NaN and infinite voxels must itself be finite");
  const auto isPowerOfTwo = [](std::int64_t n) {
    return n > 0 && std::has_single_bit(static_cast<std::uint64_t>(n));
  };
  if (!isPowerOfTwo(options.brick_cells) || options.brick_cells < 4 || options.brick_cells > 256 ||
      !isPowerOfTwo(options.tile_cells) || options.tile_cells < 2 ||
      options.tile_cells > options.brick_cells)
    throw Error("a brick has 4 to 256 cells an axis and a tile 2 up to the brick's, powers of two");
  if (options.with_curvature && !(options.curvature_epsilon >= kLeastCurvatureEpsilon &&
                                  std::isfinite(options.curvature_epsilon)))
    throw Error("the least gradient that counts for the curvature must be finite, 1/65536 or more");
}

}  // namespace

BuildReport buildPyramid(VolumeSource& source, const std::string& path,
                         const BuildOptions& options) {
  InputWatch input(source, options.cancel);
  return buildPyramid(source, input, path, options);
}

BuildReport buildPyramid(VolumeSource& source, InputWatch& input, const std::string& path,
                         const BuildOptions& options) {
  checkOptions(options);
  refuseInputAsTemporary(source, path);
  return visitVoxelType(source.info().voxel_type, [&](auto tag) {
    return Build<typename decltype(tag)::Type>(source, input, path, options).run();
  });
}

}  // namespace isobrick
