// Levels made one after the other, each as windows of bricks that pass through the pipeline.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/brick_maker.h"
#include "isobrick/preprocess/brick_pipeline.h"
#include "isobrick/preprocess/build_plan.h"
#include "isobrick/preprocess/build_region.h"
#include "isobrick/preprocess/pyramid_builder.h"

namespace isobrick {

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
