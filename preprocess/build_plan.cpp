#include "isobrick/preprocess/build_plan.h"

#include <algorithm>
#include <string>

#include "isobrick/preprocess/kernels/low_pass.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/storage/deviation_code.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/write_journal.h"

namespace isobrick {

BuildRegion::BuildRegion(const PyramidSpec& spec, const std::optional<DividedFile>& file)
    : spec_(spec), needs_(spec), rows_(file ? file->rows() : TableRows(needs_.layout())) {
  passOn();
}

// From the top down: a level passes on what the next one takes, its own bricks and those around
// them.
void BuildRegion::passOn() {
  const int levels = endLevel() - firstLevel();
  read_.resize(static_cast<std::size_t>(levels));
  passed_.resize(static_cast<std::size_t>(levels));
  const std::int64_t half = spec_.brick_cells / 2;
  IndexBox next;  // samples of level + 1
  for (int level = endLevel() - 1; level >= firstLevel(); --level) {
    const IndexBox& own = rows_.bricks(level);
    if (level + 1 < layout().lattice().levels()) next = unionOf(next, needs_.handedOn(level, own));
    passed_[place(level)] = next;
    // handedOn() gives each brick `half` samples, and the last one of an axis the rest.
    read_[place(level)] = own;
    if (next.size() > 0) {
      const Index3 first = glm::min(next.first / half, own.first);
      const Index3 end =
          glm::min(BrickLayout::ceilDivide(next.end(), half), layout().bricks(level));
      read_[place(level)] = {first, glm::max(end, own.end()) - first};
    }
    next = samples(level, read_[place(level)]);
  }
}

IndexBox BuildRegion::passedSamples(int level) const {
  if (level < firstLevel()) return {Index3(0), layout().lattice().samples(level + 1)};
  return passed_[place(level)];
}

IndexBox BuildRegion::passedTiles(int level) const {
  if (level < firstLevel()) return needs_.tiles(level, {Index3(0), layout().bricks(level)});
  return needs_.tiles(level, rows_.bricks(level));
}

IndexBox BuildRegion::samples(int level, const IndexBox& bricks) const {
  const IndexBox own = intersectionOf(bricks, rows_.bricks(level));
  const IndexBox passed = handedOn(level, bricks);
  IndexBox box;
  if (own.size() > 0) box = needs_.samples(level, own);
  if (passed.size() > 0)
    box = unionOf(box, lowPassSupport(layout().lattice(), level, spec_.filter, passed));
  return box;
}

IndexBox BuildRegion::handedOn(int level, const IndexBox& bricks) const {
  if (passed_[place(level)].size() == 0) return {};
  return intersectionOf(needs_.handedOn(level, bricks), passed_[place(level)]);
}

namespace {

constexpr std::uint64_t kMebibyte = std::uint64_t{1} << 20;
// Larger windows than these gain nothing: their reading is long amortised, and they leave the
// cache.
constexpr std::uint64_t kPipelineBytes = 48 * kMebibyte;
// But all threads wait for the last brick of a window, so it has some for each of them.
constexpr std::int64_t kBricksPerThread = 2;
// Tables and small things that do not grow with the volume; and the memory that Blosc, the kernels
// and the allocator hold for every thread beside copies of a brick.
constexpr std::uint64_t kSmallThings = 4 * kMebibyte;
constexpr std::uint64_t kThreadThings = 2 * kMebibyte;  // counts of values among them
constexpr std::uint64_t kBrickCopiesPerThread = 3;
constexpr std::uint64_t kMostStatisticsBytes = 4 * kMebibyte;

class Planner {
 public:
  Planner(const PyramidSpec& spec, const BuildRegion& region, const VolumeSource* source)
      : spec_(spec),
        layout_(spec.layout()),
        region_(region),
        source_(source),
        needs_(region.needs()),
        voxel_(voxelBytes(spec.voxel_type)) {}

  BuildPlan plan(std::uint64_t memory_bytes, int threads) {
    const std::uint64_t fixed = fixedBytes(threads);
    const std::uint64_t least = fixed + pipelineBytes(first(), {1, 1});
    if (memory_bytes < least) refuse(memory_bytes, least);
    const std::uint64_t available = memory_bytes - fixed;
    chooseWindows(available / 2, threads);
    std::uint64_t rest =
        available -
        std::min(available,
                 pipelineBytes(first(), plan_.windows[static_cast<std::size_t>(first())]));
    if (isReadInOrder()) rest -= placeSpool(rest);
    placeStores(rest);
    plan_.file_bytes_bound = fileBytesBound();
    return plan_;
  }

 private:
  int levels() const { return region_.endLevel(); }
  int first() const { return region_.firstLevel(); }

  std::uint64_t bufferBytes() const { return source_ != nullptr ? source_->bufferBytes() : 0; }
  bool isReadInOrder() const { return source_ != nullptr && !source_->readsBoxes(); }

  static std::uint64_t product(const Index3& v) {
    return static_cast<std::uint64_t>(elementCount(v));
  }
  // Samples along each axis of a box around so many bricks.
  Index3 around(int level, const Index3& bricks, std::int64_t more) const {
    return glm::min(bricks * spec_.brick_cells + Index3(more), layout_.lattice().samples(level));
  }
  std::uint64_t windowBytes(int level, const BuildPlan::WindowShape& shape) const {
    return product(
               needs_.greatestSamples(level, region_.windowBricks(level), {shape.x, shape.y, 1})) *
           voxel_;
  }
  std::uint64_t handedOnBytes(int level, const BuildPlan::WindowShape& shape) const {
    if (region_.passedSamples(level).size() == 0) return 0;
    return product(
               needs_.greatestHandedOn(level, region_.windowBricks(level), {shape.x, shape.y, 1})) *
           voxel_;
  }
  // The parts of one brick, unpacked.
  std::uint64_t brickBytes(int level) const {
    const Index3 samples = around(level, Index3(1), 3);
    const Index3 cells = glm::min(Index3(spec_.brick_cells), layout_.lattice().cells(level));
    std::uint64_t bytes = product(samples) * voxel_ +
                          product(BrickLayout::ceilDivide(cells, spec_.tile_cells)) * 2 * voxel_;
    if (level == 0 && spec_.has_curvature)
      bytes += product(BrickLayout::ceilDivide(cells, layout_.curvatureCells())) *
               kDeviationCoefficients;
    return bytes;
  }
  // The same in the file.
  std::uint64_t storedBytes(int level) const {
    const bool is_elsewhere = level == 0 && spec_.level0 != Level0Place::kStored;
    return brickBytes(level) - (is_elsewhere ? product(around(level, Index3(1), 3)) * voxel_ : 0);
  }
  std::uint64_t pipelineBytes(int level, const BuildPlan::WindowShape& shape) const {
    const auto bricks = static_cast<std::uint64_t>(shape.x * shape.y);
    // Packing takes as much again as the samples of a brick.
    return kBuildWindows * (windowBytes(level, shape) + 2 * bricks * brickBytes(level)) +
           handedOnBytes(level, shape);
  }

  std::uint64_t fixedBytes(int threads) const {
    const std::uint64_t bricks = region_.rows().count();
    std::uint64_t bytes =
        kSmallThings + bufferBytes() + bricks * (sizeof(BrickRow) + sizeof(ValueRange));
    if (isReadInOrder())
      bytes +=
          static_cast<std::uint64_t>(SliceSpool::rowsPerRead(source_->info()) * spec_.voxels.x) *
          voxel_;
    const std::uint64_t per_thread = kThreadThings + kBrickCopiesPerThread * brickBytes(first()) +
                                     windowBytes(first(), {1, 1}) / 2;
    return bytes + static_cast<std::uint64_t>(threads) * per_thread;
  }

  [[noreturn]] void refuse(std::uint64_t memory_bytes, std::uint64_t least) const {
    const auto mebibytes = [](std::uint64_t bytes) {
      return concat((bytes + kMebibyte - 1) / kMebibyte, "M");
    };
    const std::uint64_t held = bufferBytes();
    const std::string name = source_ != nullptr ? source_->info().source : "super-bricks";
    throw fileError(name, "a memory of ", mebibytes(memory_bytes), " is too small to build from '",
                    name, "', which takes ", mebibytes(least),
                    held > least / 2
                        ? ", most of it because this kind of file is not read piece by "
                          "piece; convert it to an uncompressed .mhd, or allow "
                        : "; allow ",
                    mebibytes(least), " or more", Remedy::kAllowMoreMemory);
  }

  void chooseWindows(std::uint64_t most_bytes, int threads) {
    plan_.windows.resize(static_cast<std::size_t>(first()));
    for (int level = first(); level < levels(); ++level) {
      const Index3 bricks = region_.windowBricks(level).count;
      BuildPlan::WindowShape shape;
      const auto fits = [&](const BuildPlan::WindowShape& s) {
        const bool is_for_all = s.x * s.y <= kBricksPerThread * threads;
        return pipelineBytes(level, s) <=
               (is_for_all ? most_bytes : std::min(most_bytes, kPipelineBytes));
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
    const std::int64_t slices = region_.samples(0, region_.windowBricks(0)).count.z;
    const std::int64_t least = needs_.greatestSamples(0, region_.windowBricks(0), Index3(1)).z;
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
    if (level < std::max(first(), 1) || level > levels()) return 0;
    if (region_.passedSamples(level - 1).size() == 0) return 0;
    const Index3 tiles = region_.passedTiles(level - 1).count;
    return (product(region_.passedSamples(level - 1).count) + 2 * product(tiles)) * voxel_;
  }

  // The store of a level and that of the next are there at the same time.
  void placeStores(std::uint64_t rest) {
    std::uint64_t most_in_files = 0;
    for (int level = 0; level <= levels(); ++level) {
      const bool fits = storeBytes(level) + storeBytes(level + 1) <= rest;
      plan_.stores.push_back(fits ? ScratchVolume::Place::kMemory : ScratchVolume::Place::kFile);
      if (!fits) most_in_files = std::max(most_in_files, storeBytes(level) + storeBytes(level + 1));
    }
    plan_.scratch_file_bytes += most_in_files;
  }

  std::uint64_t fileBytesBound() const {
    std::uint64_t bytes = kMebibyte;            // header, provenance
    if (levels() < layout_.lattice().levels())  // what the index takes
      bytes += storeBytes(levels()) + kMostStatisticsBytes;
    for (int level = first(); level < levels(); ++level)
      bytes += product(region_.rows().bricks(level).count) *
               (storedBytes(level) + format::kSampleAlignment + 2 * format::kPartAlignment +
                format::rowBytes(format::kMostKinds));
    return bytes;
  }

  const PyramidSpec& spec_;
  const BrickLayout layout_;
  const BuildRegion& region_;
  const VolumeSource* const source_;
  const BrickNeeds& needs_;
  const std::uint64_t voxel_;
  BuildPlan plan_;
};

}  // namespace

BuildPlan makeBuildPlan(const PyramidSpec& spec, const BuildRegion& region,
                        const VolumeSource* source, std::uint64_t memory_bytes, int threads) {
  return Planner(spec, region, source).plan(memory_bytes, threads);
}

}  // namespace isobrick
