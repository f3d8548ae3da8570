#include "isobrick/preprocess/build_plan.h"

#include <algorithm>
#include <string>

#include "isobrick/preprocess/slice_spool.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/write_journal.h"

namespace isobrick {
namespace {

constexpr std::uint64_t kMebibyte = std::uint64_t{1} << 20;
// Larger windows than these gain nothing: their reading is long amortised, and they leave the
// cache.
constexpr std::uint64_t kPipelineBytes = 48 * kMebibyte;
// Tables and small things that do not grow with the volume; and the memory that Blosc, the kernels
// and the allocator hold for every thread beside copies of a brick.
constexpr std::uint64_t kSmallThings = 4 * kMebibyte;
constexpr std::uint64_t kThreadThings = 2 * kMebibyte;  // counts of values among them
constexpr std::uint64_t kBrickCopiesPerThread = 3;

class Planner {
 public:
  Planner(const PyramidSpec& spec, const VolumeSource& source)
      : spec_(spec),
        layout_(spec.layout()),
        source_(source),
        needs_(spec),
        voxel_(voxelBytes(spec.voxel_type)) {}

  BuildPlan plan(std::uint64_t memory_bytes, int threads) {
    const std::uint64_t fixed = fixedBytes(threads);
    const std::uint64_t least = fixed + pipelineBytes(0, {1, 1});
    if (memory_bytes < least) refuse(memory_bytes, least);
    const std::uint64_t available = memory_bytes - fixed;
    chooseWindows(std::max(pipelineBytes(0, {1, 1}), std::min(available / 2, kPipelineBytes)));
    std::uint64_t rest = available - std::min(available, pipelineBytes(0, plan_.windows[0]));
    if (!source_.readsBoxes()) rest -= placeSpool(rest);
    placeStores(rest);
    plan_.file_bytes_bound = fileBytesBound();
    return plan_;
  }

 private:
  int levels() const { return layout_.lattice().levels(); }

  static std::uint64_t product(const Index3& v) {
    return static_cast<std::uint64_t>(elementCount(v));
  }
  // Samples along each axis of a box around so many bricks.
  Index3 around(int level, const Index3& bricks, std::int64_t more) const {
    return glm::min(bricks * spec_.brick_cells + Index3(more), layout_.lattice().samples(level));
  }
  std::uint64_t windowBytes(int level, const BuildPlan::WindowShape& shape) const {
    return product(needs_.greatestSamples(level, {shape.x, shape.y, 1})) * voxel_;
  }
  std::uint64_t handedOnBytes(int level, const BuildPlan::WindowShape& shape) const {
    if (level + 1 == levels()) return 0;
    return product(needs_.greatestHandedOn(level, {shape.x, shape.y, 1})) * voxel_;
  }
  // The parts of one brick, unpacked.
  std::uint64_t brickBytes(int level) const {
    const Index3 samples = around(level, Index3(1), 3);
    const Index3 cells = glm::min(Index3(spec_.brick_cells), layout_.lattice().cells(level));
    std::uint64_t bytes = product(samples) * voxel_ +
                          product(BrickLayout::ceilDivide(cells, spec_.tile_cells)) * 2 * voxel_;
    if (level == 0 && spec_.has_curvature) bytes += product(BrickLayout::ceilDivide(cells, 2)) * 3;
    return bytes;
  }
  std::uint64_t pipelineBytes(int level, const BuildPlan::WindowShape& shape) const {
    const auto bricks = static_cast<std::uint64_t>(shape.x * shape.y);
    // Packing takes as much again as the samples of a brick.
    return kBuildWindows * (windowBytes(level, shape) + 2 * bricks * brickBytes(level)) +
           handedOnBytes(level, shape);
  }

  std::uint64_t fixedBytes(int threads) const {
    std::uint64_t bricks = 0;
    for (int level = 0; level < levels(); ++level) bricks += product(layout_.bricks(level));
    std::uint64_t bytes =
        kSmallThings + source_.bufferBytes() + bricks * (sizeof(BrickRow) + sizeof(ValueRange));
    if (!source_.readsBoxes())
      bytes +=
          static_cast<std::uint64_t>(SliceSpool::rowsPerRead(source_.info()) * spec_.voxels.x) *
          voxel_;
    const std::uint64_t per_thread =
        kThreadThings + kBrickCopiesPerThread * brickBytes(0) + windowBytes(0, {1, 1}) / 2;
    return bytes + static_cast<std::uint64_t>(threads) * per_thread;
  }

  [[noreturn]] void refuse(std::uint64_t memory_bytes, std::uint64_t least) const {
    const auto mebibytes = [](std::uint64_t bytes) {
      return std::to_string((bytes + kMebibyte - 1) / kMebibyte) + "M";
    };
    const std::uint64_t held = source_.bufferBytes();
    throw Error(
        "a memory of " + mebibytes(memory_bytes) + " is too small to build from '" +
            source_.info().source + "', which takes " + mebibytes(least) +
            (held > least / 2 ? ", most of it because this kind of file is not read piece by "
                                "piece; convert it to an uncompressed .mhd, or allow "
                              : "; allow ") +
            mebibytes(least) + " or more",
        {.path = source_.info().source}, {Remedy::kAllowMoreMemory});
  }

  void chooseWindows(std::uint64_t pipeline_bytes) {
    for (int level = 0; level < levels(); ++level) {
      const Index3 bricks = layout_.bricks(level);
      BuildPlan::WindowShape shape;
      const auto fits = [&](const BuildPlan::WindowShape& s) {
        return pipelineBytes(level, s) <= pipeline_bytes;
      };
      while (shape.x < bricks.x && fits({shape.x + 1, 1})) ++shape.x;
      if (shape.x == bricks.x)
        while (shape.y < bricks.y && fits({shape.x, shape.y + 1})) ++shape.y;
      plan_.windows.push_back(shape);
      plan_.window_bytes = std::max(plan_.window_bytes, windowBytes(level, shape));
      plan_.handed_on_bytes = std::max(plan_.handed_on_bytes, handedOnBytes(level, shape));
    }
  }

  // Returns the memory that it takes.
  std::uint64_t placeSpool(std::uint64_t rest) {
    const std::int64_t slices = spec_.voxels.z;
    const std::int64_t least = needs_.greatestSamples(0, Index3(1)).z;
    // A slab more: it comes in while the one before is worked on.
    const std::int64_t most = std::min(slices, least + spec_.brick_cells);
    const std::uint64_t slice_bytes =
        static_cast<std::uint64_t>(spec_.voxels.x * spec_.voxels.y) * voxel_;
    const auto affordable = static_cast<std::int64_t>(
        std::min<std::uint64_t>(rest / 4 * 3 / slice_bytes, static_cast<std::uint64_t>(most)));
    if (affordable >= least) {
      plan_.spool_slices = affordable;
      return static_cast<std::uint64_t>(affordable) * slice_bytes;
    }
    plan_.spool_slices = most;
    plan_.spool_place = ScratchVolume::Place::kFile;
    plan_.scratch_file_bytes += static_cast<std::uint64_t>(most) * slice_bytes;
    return 0;
  }

  std::uint64_t storeBytes(int level) const {
    if (level == 0 || level >= levels()) return 0;
    const Index3 tiles =
        BrickLayout::ceilDivide(layout_.lattice().cells(level - 1), spec_.tile_cells);
    return (product(layout_.lattice().samples(level)) + 2 * product(tiles)) * voxel_;
  }

  // The store of a level and that of the next are there at the same time.
  void placeStores(std::uint64_t rest) {
    std::uint64_t most_in_files = 0;
    for (int level = 0; level < levels(); ++level) {
      const bool fits = storeBytes(level) + storeBytes(level + 1) <= rest;
      plan_.stores.push_back(fits ? ScratchVolume::Place::kMemory : ScratchVolume::Place::kFile);
      if (!fits) most_in_files = std::max(most_in_files, storeBytes(level) + storeBytes(level + 1));
    }
    plan_.scratch_file_bytes += most_in_files;
  }

  std::uint64_t fileBytesBound() const {
    std::uint64_t bytes = kMebibyte;  // header, provenance
    for (int level = 0; level < levels(); ++level)
      bytes += product(layout_.bricks(level)) *
               (brickBytes(level) + format::kSampleAlignment + 2 * format::kPartAlignment +
                format::rowBytes(format::kMostKinds));
    return bytes;
  }

  const PyramidSpec& spec_;
  const BrickLayout layout_;
  const VolumeSource& source_;
  const BrickNeeds needs_;
  const std::uint64_t voxel_;
  BuildPlan plan_;
};

}  // namespace

BuildPlan makeBuildPlan(const PyramidSpec& spec, const VolumeSource& source,
                        std::uint64_t memory_bytes, int threads) {
  return Planner(spec, source).plan(memory_bytes, threads);
}

}  // namespace isobrick
