// Levels made one after the other, each as windows of bricks that pass through the threads of a
// build: one reads, those of the TBB arena make bricks, one writes.
#pragma once

#include <tbb/concurrent_queue.h>

#include <atomic>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/preprocess/brick_maker.h"
#include "isobrick/preprocess/brick_window.h"
#include "isobrick/preprocess/build_plan.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/storage/brick_encoder.h"

namespace isobrick {

// One window on its way from reading to making.
struct BrickWindow {
  IndexBox bricks;
  IndexBox sample_box;  // of `samples`, dense
  LargeBuffer samples;
  bool has_samples = false;  // false: all its bricks exist already, nothing was read
};

// Bricks on their way from making to writing, in the order of the brick table.
struct BrickBatch {
  std::vector<EncodedBrick> bricks;
  std::size_t first = 0, count = 0;  // those to be written
};

// Moves windows and batches between three stages. A buffer that is under way belongs to the stage
// that took it last; if all are under way, a stage that needs one waits. The first failure of any
// stage stops all, and is thrown by run() or finish() on the caller's thread.
class BrickPipeline {
 public:
  using Read = std::function<void(std::int64_t window, BrickWindow&)>;
  using Make = std::function<void(const BrickWindow&, BrickBatch&)>;
  using Write = std::function<void(const BrickBatch&)>;

  // Starts the writing thread.
  BrickPipeline(const BuildPlan& plan, Write write);
  ~BrickPipeline();
  BrickPipeline(const BrickPipeline&) = delete;
  BrickPipeline& operator=(const BrickPipeline&) = delete;

  // Takes windows 0 .. windows - 1 through reading (a thread of its own, in order) and making (the
  // caller's thread, in order), and passes the batches on to the writing thread.
  void run(std::int64_t windows, const Read& read, const Make& make);
  // Waits until all batches were written. Afterwards nothing can be run.
  void finish();

 private:
  void readAll(std::int64_t windows, const Read& read);
  void writeAll(const Write& write);
  void fail(std::exception_ptr failure);
  void throwFailure();
  // Waits for the next one. Null: there is none, or a stage failed.
  template <typename T>
  T* take(tbb::concurrent_bounded_queue<T*>& queue) {
    T* next = nullptr;
    queue.pop(next);
    return is_over_ ? nullptr : next;
  }

  std::vector<BrickWindow> windows_;
  std::vector<BrickBatch> batches_;
  // Each has one stage that takes from it, which ends at a null.
  tbb::concurrent_bounded_queue<BrickWindow*> free_windows_, full_windows_;
  tbb::concurrent_bounded_queue<BrickBatch*> free_batches_, full_batches_;
  std::atomic<bool> is_over_{false};  // before its time
  std::mutex mutex_;                  // guards failure_
  std::exception_ptr failure_;
  std::thread writer_;  // last: it uses all the others
};

// The voxels of level 0, as a LevelMaker asks for them: all members but the last are called by the
// thread that reads, in the order of the windows.
template <typename T>
class LevelInput {
 public:
  virtual ~LevelInput() = default;
  // Before the first window; slices below are never asked for.
  virtual void begin(std::int64_t first_slice) = 0;
  // Slices below are not asked for any more.
  virtual void releaseBefore(std::int64_t slice) = 0;
  // The window that is read next, and the one behind it.
  virtual void announce(std::span<const IndexBox> boxes) = 0;
  virtual void read(const IndexBox& slices, std::byte* to) = 0;
  // A window was read, as dense `voxels`; `own` are those that no other window has. May change
  // them.
  virtual void check(const IndexBox& box, std::byte* voxels, const IndexBox& own) = 0;
  // By the thread that calls run(): what a window of bricks of level 0 passed on.
  virtual void passedOn(const IndexBox& bricks, const HandedOn<T>& handed_on) = 0;
};

// The samples of a level and the tile ranges of the level below it.
struct LevelStore {
  ScratchVolume samples, finer_tiles;  // the latter with two elements for each tile, along x
};

// A store for the samples of `level`, which the level below passes on, as far as the region has or
// takes them; null at the top of the pyramid. T is the voxel type.
template <typename T>
std::unique_ptr<LevelStore> makeLevelStore(const BuildRegion& region, const BuildPlan& plan,
                                           int level, const std::string& folder);

// Makes the levels of a region and writes their bricks; T is the voxel type. The samples for the
// next level wait in a store.
template <typename T>
class LevelMaker {
 public:
  // All outlive it. `folder` is for temporary files.
  LevelMaker(const PyramidSpec& spec, const BuildRegion& region, const BuildPlan& plan,
             const BuildOptions& options, const std::string& folder, PyramidWriter& writer,
             BrickClosures& closures, VoxelStatistics& statistics, PhaseTimes& times)
      : region_(region),
        plan_(plan),
        options_(options),
        folder_(folder),
        writer_(writer),
        times_(times),
        maker_(spec, options.codec, region.needs(), closures, statistics, times) {}

  // Makes all levels. `input` has the voxels, if the region begins at level 0, and `store` the
  // samples of its first level else. Returns what the last one passes on; null at the top.
  std::unique_ptr<LevelStore> run(LevelInput<T>* input, std::unique_ptr<LevelStore> store);

  // The range of the voxels in the region's bricks; after run().
  const ValueRange& voxelRange() const { return voxel_range_; }

 private:
  void makeLevel(int level, LevelInput<T>* input, const LevelStore* store, LevelStore* next,
                 BrickPipeline& pipeline);
  bool isResumed(int level, const Index3& brick) const;
  bool hasToBeRead(int level, const IndexBox& bricks) const;
  void beginInput(LevelInput<T>& input, const BrickWindows& windows) const;
  std::int64_t firstSliceOf(const IndexBox& window) const;
  void readWindow(int level, LevelInput<T>* input, const LevelStore* store, BrickWindow& window);
  static std::vector<IndexBox> piecesOf(const IndexBox& box);
  void makeBricks(int level, const BrickWindow& window, const LevelStore* store,
                  const HandedOn<T>& handed_on, BrickBatch& batch);
  void writeBatch(const BrickBatch& batch);

  static std::size_t bytesOf(const IndexBox& box) {
    return static_cast<std::size_t>(box.size()) * sizeof(T);
  }

  const BuildRegion& region_;
  const BuildPlan& plan_;
  const BuildOptions& options_;
  const std::string& folder_;
  PyramidWriter& writer_;
  PhaseTimes& times_;
  BrickMaker<T> maker_;
  ValueRange voxel_range_;
  std::size_t bricks_made_ = 0;
};

}  // namespace isobrick
