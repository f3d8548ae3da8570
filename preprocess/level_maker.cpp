#include "isobrick/preprocess/level_maker.h"

#include <algorithm>
#include <array>
#include <vector>

#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {

BrickPipeline::BrickPipeline(const BuildPlan& plan, Write write)
    : windows_(kBuildWindows), batches_(kBuildWindows) {
  std::size_t most_bricks = 1;
  for (const BuildPlan::WindowShape& shape : plan.windows)
    most_bricks = std::max(most_bricks, static_cast<std::size_t>(shape.x * shape.y));
  for (BrickWindow& window : windows_) {
    window.samples = LargeBuffer(plan.window_bytes);
    free_windows_.push(&window);
  }
  for (BrickBatch& batch : batches_) {
    batch.bricks.resize(most_bricks);
    free_batches_.push(&batch);
  }
  writer_ = std::thread([this, write] { writeAll(write); });
}

BrickPipeline::~BrickPipeline() {
  if (!writer_.joinable()) return;
  fail(nullptr);
  writer_.join();
}

void BrickPipeline::run(std::int64_t windows, const Read& read, const Make& make) {
  std::thread reader([&] { readAll(windows, read); });
  try {
    for (std::int64_t i = 0; i < windows; ++i) {
      BrickWindow* const window = take(full_windows_);
      BrickBatch* const batch = window != nullptr ? take(free_batches_) : nullptr;
      if (batch == nullptr) break;  // a stage failed
      make(*window, *batch);
      free_windows_.push(window);
      full_batches_.push(batch);
    }
  } catch (...) {
    fail(std::current_exception());
  }
  reader.join();
  throwFailure();
}

void BrickPipeline::finish() {
  full_batches_.push(nullptr);
  writer_.join();
  throwFailure();
}

void BrickPipeline::readAll(std::int64_t windows, const Read& read) {
  try {
    for (std::int64_t i = 0; i < windows; ++i) {
      BrickWindow* const window = take(free_windows_);
      if (window == nullptr) return;
      read(i, *window);
      full_windows_.push(window);
    }
  } catch (...) {
    fail(std::current_exception());
  }
}

void BrickPipeline::writeAll(const Write& write) {
  try {
    while (BrickBatch* const batch = take(full_batches_)) {
      write(*batch);
      free_batches_.push(batch);
    }
  } catch (...) {
    fail(std::current_exception());
  }
}

// Without a failure, just stops.
void BrickPipeline::fail(std::exception_ptr failure) {
  {
    const std::lock_guard lock(mutex_);
    if (!failure_) failure_ = failure;
  }
  is_over_ = true;
  for (auto* const queue : {&free_windows_, &full_windows_}) queue->push(nullptr);
  for (auto* const queue : {&free_batches_, &full_batches_}) queue->push(nullptr);
}

void BrickPipeline::throwFailure() {
  const std::lock_guard lock(mutex_);
  if (failure_) std::rethrow_exception(failure_);
}

template <typename T>
std::unique_ptr<LevelStore> makeLevelStore(const BuildRegion& region, const BuildPlan& plan,
                                           int level, const std::string& folder) {
  if (level == region.layout().lattice().levels()) return nullptr;
  const ScratchVolume::Place place = plan.stores[static_cast<std::size_t>(level)];
  return std::unique_ptr<LevelStore>(
      new LevelStore{{region.passedSamples(level - 1), sizeof(T), place, folder},
                     {tilePairs(region.passedTiles(level - 1)), sizeof(T), place, folder}});
}

template <typename T>
std::unique_ptr<LevelStore> LevelMaker<T>::run(LevelInput<T>* input,
                                               std::unique_ptr<LevelStore> store) {
  BrickPipeline pipeline(plan_, [this](const BrickBatch& batch) { writeBatch(batch); });
  for (int level = region_.firstLevel(); level < region_.endLevel(); ++level) {
    std::unique_ptr<LevelStore> next = makeLevelStore<T>(region_, plan_, level + 1, folder_);
    makeLevel(level, level == 0 ? input : nullptr, store.get(), next.get(), pipeline);
    store = std::move(next);
  }
  pipeline.finish();
  return store;
}

template <typename T>
void LevelMaker<T>::makeLevel(int level, LevelInput<T>* input, const LevelStore* store,
                              LevelStore* next, BrickPipeline& pipeline) {
  const BuildPlan::WindowShape& shape = plan_.windows[static_cast<std::size_t>(level)];
  const BrickWindows windows(region_.windowBricks(level), shape.x, shape.y);
  if (input != nullptr) beginInput(*input, windows);
  LargeBuffer handed_on_samples(plan_.handed_on_bytes);
  pipeline.run(
      windows.count(),
      [&](std::int64_t i, BrickWindow& window) {
        window.bricks = windows.window(i);
        if (input != nullptr) {
          std::vector<IndexBox> ahead;
          for (std::int64_t n = i; n < std::min(i + 2, windows.count()); ++n)
            if (hasToBeRead(0, windows.window(n)))
              ahead.push_back(region_.samples(0, windows.window(n)));
          input->announce(ahead);
        }
        readWindow(level, input, store, window);
      },
      [&](const BrickWindow& window, BrickBatch& batch) {
        HandedOn<T> handed_on;
        if (next != nullptr) {
          handed_on.box = region_.handedOn(level, window.bricks);
          handed_on.samples =
              reinterpret_cast<T*>(handed_on_samples.dataFor(bytesOf(handed_on.box)));
          handed_on.tiles = &next->finer_tiles;
        }
        makeBricks(level, window, store, handed_on, batch);
        if (next == nullptr) return;
        if (handed_on.box.size() > 0) next->samples.write(handed_on.box, handed_on.samples);
        if (input != nullptr) input->passedOn(window.bricks, handed_on);
      });
}

// Bricks that an earlier build wrote; own ones alone.
template <typename T>
bool LevelMaker<T>::isResumed(int level, const Index3& brick) const {
  return region_.rows().row(level, brick) < writer_.bricksResumed();
}

// Unless all of its bricks exist already.
template <typename T>
bool LevelMaker<T>::hasToBeRead(int level, const IndexBox& bricks) const {
  const IndexBox own = intersectionOf(bricks, region_.rows().bricks(level));
  // What --nan-as replaces and --mask-nan keeps is counted, so all voxels are read.
  const bool counts =
      level == 0 && std::is_same_v<T, float> && (options_.nan_as.has_value() || options_.mask_nan);
  return counts || own.size() < bricks.size() || !isResumed(level, own.end() - Index3(1));
}

// The first of all windows of the window's slab, which may come in any order of their first slices.
template <typename T>
std::int64_t LevelMaker<T>::firstSliceOf(const IndexBox& window) const {
  IndexBox slab = region_.windowBricks(0);
  slab.first.z = window.first.z;
  slab.count.z = window.count.z;
  return region_.samples(0, slab).first.z;
}

template <typename T>
void LevelMaker<T>::beginInput(LevelInput<T>& input, const BrickWindows& windows) const {
  for (std::int64_t i = 0; i < windows.count(); ++i) {
    const IndexBox bricks = windows.window(i);
    if (hasToBeRead(0, bricks)) return input.begin(firstSliceOf(bricks));
  }
}

template <typename T>
void LevelMaker<T>::readWindow(int level, LevelInput<T>* input, const LevelStore* store,
                               BrickWindow& window) {
  if (options_.cancel != nullptr) options_.cancel->check();
  window.has_samples = hasToBeRead(level, window.bricks);
  if (!window.has_samples) return;
  const PhaseTimes::Timer timer(times_, BuildStep::kRead);
  window.sample_box = region_.samples(level, window.bricks);
  std::byte* const samples = window.samples.dataFor(bytesOf(window.sample_box));
  if (window.sample_box.size() == 0) return;
  if (input != nullptr) input->releaseBefore(firstSliceOf(window.bricks));
  // A window may be large and a disk slow: a request to cancel must not wait for all of it.
  std::byte* to = samples;
  for (const IndexBox& slices : piecesOf(window.sample_box)) {
    if (options_.cancel != nullptr) options_.cancel->check();
    if (input != nullptr)
      input->read(slices, to);
    else
      store->samples.read(slices, to);
    to += bytesOf(slices);
  }
  if (input == nullptr) return;
  const IndexBox own = intersectionOf(window.bricks, region_.rows().bricks(0));
  input->check(window.sample_box, samples,
               own.size() > 0 ? region_.needs().ownVoxels(own) : IndexBox{});
}

// The box as some slices at a time, of some MiB together.
template <typename T>
std::vector<IndexBox> LevelMaker<T>::piecesOf(const IndexBox& box) {
  constexpr std::int64_t kPieceBytes = std::int64_t{4} << 20;
  const auto slice_bytes = box.count.x * box.count.y * static_cast<std::int64_t>(sizeof(T));
  const std::int64_t most = std::max<std::int64_t>(1, kPieceBytes / slice_bytes);
  std::vector<IndexBox> pieces;
  for (std::int64_t z = 0; z < box.count.z; z += most)
    pieces.push_back(
        {box.first + Index3(0, 0, z), {box.count.x, box.count.y, std::min(most, box.count.z - z)}});
  return pieces;
}

template <typename T>
void LevelMaker<T>::makeBricks(int level, const BrickWindow& window, const LevelStore* store,
                               const HandedOn<T>& handed_on, BrickBatch& batch) {
  const auto samples =
      SampleBlock<T>::dense(reinterpret_cast<const T*>(window.samples.data()), window.sample_box);
  // Its own bricks in the order of the table, and those around them.
  std::vector<Index3> own, around;
  forEachIndex(window.bricks, [&](const Index3& brick) {
    (region_.isOwn(level, brick) ? own : around).push_back(brick);
  });
  batch.count = own.size();
  // Resumed bricks come first, for bricks are written in this order.
  batch.first = 0;
  while (batch.first < batch.count && isResumed(level, own[batch.first])) ++batch.first;
  std::vector<ValueRange> voxels(batch.count);
  isolatedForEach(std::size_t{0}, own.size() + around.size(), [&](std::size_t i) {
    if (options_.cancel != nullptr && options_.cancel->requested()) return;
    if (i >= own.size())
      maker_.passOn(level, region_.handedOn(level, {around[i - own.size()], Index3(1)}), samples,
                    handed_on);
    else if (i < batch.first)
      voxels[i] = maker_.remake(level, own[i], writer_, handed_on);
    else
      voxels[i] =
          maker_.make(level, own[i], samples, store != nullptr ? &store->finer_tiles : nullptr,
                      handed_on, batch.bricks[i]);
  });
  for (const ValueRange& range : voxels) voxel_range_.include(range);
  bricks_made_ += batch.count;
  if (options_.cancel != nullptr) options_.cancel->check();
  if (options_.progress)
    options_.progress(
        "bricks", static_cast<double>(bricks_made_) / static_cast<double>(region_.rows().count()));
}

template <typename T>
void LevelMaker<T>::writeBatch(const BrickBatch& batch) {
  const PhaseTimes::Timer timer(times_, BuildStep::kWrite);
  for (std::size_t i = batch.first; i < batch.count; ++i) {
    if (options_.cancel != nullptr) options_.cancel->check();
    writer_.write(batch.bricks[i]);
  }
  writer_.flush();
}

#define ISOBRICK_INSTANTIATE(T)                                                                \
  template std::unique_ptr<LevelStore> makeLevelStore<T>(const BuildRegion&, const BuildPlan&, \
                                                         int, const std::string&);             \
  template class LevelMaker<T>;
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
