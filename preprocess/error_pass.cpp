#include "isobrick/preprocess/error_pass.h"

#include <malloc.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <deque>
#include <mutex>
#include <numeric>

#include "isobrick/preprocess/error_chunk.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

constexpr std::uint32_t kBins = 32;
// Cells of level 0 that are looked at together; at the ends of a region some more.
constexpr Index3 kChunkCells = ErrorChunk::kMostCells - Index3(2 * ErrorChunk::kAlignment);
// Cells of level 0 per axis that bricks are written for together.
constexpr std::int64_t kLeastRegion = 64;
// Outliers, metal in a CT, would make all bins wide.
constexpr double kOutliers = 1e-3;
// What is read back takes a part of the memory; more than this gains nothing.
constexpr std::uint64_t kMostReadBytes = std::uint64_t{256} << 20;
// Of memory for each thread that works on chunks: twice what it holds.
constexpr std::uint64_t kBytesPerThread = std::uint64_t{64} << 20;

int threadsFor(std::uint64_t memory_bytes) {
  const auto most = static_cast<std::uint64_t>(tbb::this_task_arena::max_concurrency());
  return static_cast<int>(std::clamp(memory_bytes / kBytesPerThread, std::uint64_t{1}, most));
}

// The bin of the histogram up to which there is this share of the voxels.
std::size_t quantile(const VoxelHistogram& histogram, double share) {
  const auto counts = histogram.counts();
  const double all =
      static_cast<double>(std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}));
  double seen = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    seen += static_cast<double>(counts[i]);
    if (seen >= share * all) return i;
  }
  return counts.size() - 1;
}

}  // namespace

ErrorBins errorBinsOf(const VoxelHistogram& histogram, const ValueRange& values, int last_level) {
  auto least = static_cast<double>(histogram.bin(quantile(histogram, kOutliers)).min);
  auto greatest = static_cast<double>(histogram.bin(quantile(histogram, 1 - kOutliers)).max);
  if (!(greatest > least)) {
    least = static_cast<double>(values.min);
    greatest = static_cast<double>(values.max);
  }
  // A constant volume has no errors.
  const double width = std::max((greatest - least) / kBins, 0x1p-140);
  return {least, width, kBins, last_level};
}

// The error part of a brick while it is made.
template <typename T>
struct ErrorPass<T>::BrickErrors {
  int level = 0;
  Index3 brick{0};
  IndexBox cells;
  std::vector<TileBins> tiles;
  std::vector<bool> is_constant;     // by tile, with all that is finer in it
  std::vector<std::size_t> offsets;  // of the tiles' first blocks
  std::size_t elements = 0;
  EncodedPart part;
  std::mutex mutex;  // guards part.bytes, to which all chunks around add
};

template <typename T>
ErrorPass<T>::ErrorPass(const PyramidSpec& spec, const ErrorBins& bins, const ValueRange& values,
                        format::Codec codec, std::uint64_t memory_bytes, PyramidWriter& writer,
                        PhaseTimes& times)
    : spec_(spec),
      layout_(spec.layout()),
      bins_(bins),
      values_(values),
      codec_(codec),
      writer_(writer),
      times_(times),
      threads_(threadsFor(memory_bytes)),
      written_(spec, writer, std::min(memory_bytes / 8, kMostReadBytes)),
      region_voxels_(std::max(kLeastRegion, spec.brick_cells << bins.last_level)) {}

template <typename T>
Index3 ErrorPass<T>::regions() const {
  return BrickLayout::ceilDivide(layout_.lattice().cells(0), region_voxels_);
}

template <typename T>
void ErrorPass<T>::run(const CancelFlag* cancel, const std::function<void(double)>& progress) {
  tbb::task_arena arena(threads_);
  malloc_trim(0);  // the buffers of the levels went back to the allocator, not to the system
  const Index3 margin(ErrorChunk::marginOf(bins_.last_level));
  const Index3 all_cells = layout_.lattice().cells(0);
  std::int64_t done = 0;
  forEachIndex({Index3(0), regions()}, [&](const Index3& region) {
    std::deque<BrickErrors> bricks = bricksIn(region);
    // Chunks share faces; those at the ends of a region take in what lies beyond and matters.
    const Index3 first = region * region_voxels_;
    const Index3 end = glm::min(first + Index3(region_voxels_), all_cells);
    const Index3 count = (end - first + kChunkCells - Index3(1)) / kChunkCells;
    const auto chunk = [&](const Index3& at) {
      Index3 from = first + at * kChunkCells;
      Index3 to = glm::min(from + kChunkCells, end);
      for (int axis = 0; axis < 3; ++axis) {
        if (at[axis] == 0) from[axis] = std::max(from[axis] - margin[axis], std::int64_t{0});
        if (at[axis] + 1 == count[axis])
          to[axis] = std::min(to[axis] + margin[axis], all_cells[axis]);
      }
      return IndexBox{from, to - from};
    };
    // A layer of chunks at a time: progress is told between them.
    for (std::int64_t z = 0; z < count.z; ++z) {
      arena.execute([&] {
        isolatedForEach(std::int64_t{0}, count.x * count.y, [&](std::int64_t i) {
          if (cancel != nullptr && cancel->requested()) return;
          findChunk(chunk(Index3(i % count.x, i / count.x, z)), bricks);
        });
      });
      const Index3 layer(end.x - first.x, end.y - first.y,
                         std::min(kChunkCells.z, end.z - first.z - z * kChunkCells.z));
      done += elementCount(layer);
      progress(static_cast<double>(done) / static_cast<double>(elementCount(all_cells)));
    }
    writeBricks(bricks);
  });
}

// The bricks in a region whose errors are stored, with room for their codes.
template <typename T>
std::deque<typename ErrorPass<T>::BrickErrors> ErrorPass<T>::bricksIn(const Index3& region) const {
  std::deque<BrickErrors> bricks;
  for (int level = kFirstErrorLevel; level <= bins_.last_level; ++level) {
    const std::int64_t along = (region_voxels_ >> level) / spec_.brick_cells;
    const Index3 first = region * along;
    const Index3 count = glm::min(Index3(along), layout_.bricks(level) - first);
    forEachIndex({first, count}, [&](const Index3& at) {
      BrickErrors& brick = bricks.emplace_back();
      brick.level = level;
      brick.brick = at;
      brick.cells = layout_.brickCellBox(level, at);
      const Index3 tiles = layout_.brickTiles(level, at);
      const std::vector<ValueRange> ranges = written_.tileRanges(level, at);
      for (std::size_t tile = 0; tile < ranges.size(); ++tile) {
        const Index3 begin = indexAt(static_cast<std::int64_t>(tile), tiles) * spec_.tile_cells;
        const Index3 cells = glm::min(Index3(spec_.tile_cells), brick.cells.count - begin);
        brick.tiles.emplace_back(bins_, ranges[tile]);
        brick.is_constant.push_back(!(ranges[tile].min < ranges[tile].max));
        brick.offsets.push_back(brick.elements);
        brick.elements +=
            brick.tiles.back().blocks() * static_cast<std::size_t>(elementCount(cells));
      }
      brick.part.bytes.resize(brick.elements);
    });
  }
  return bricks;
}

// Whether tiles of the last level say so. Those of other regions are not known.
template <typename T>
bool ErrorPass<T>::isConstant(const IndexBox& cells, const std::deque<BrickErrors>& bricks) const {
  const Index3 first = cells.first >> std::int64_t{bins_.last_level};
  const Index3 end = BrickLayout::ceilDivide(cells.end(), std::int64_t{1} << bins_.last_level);
  std::int64_t seen = 0;
  for (const BrickErrors& brick : bricks) {
    if (brick.level != bins_.last_level) continue;
    const Index3 from = glm::max(first, brick.cells.first) - brick.cells.first;
    const Index3 to = glm::min(end, brick.cells.end()) - brick.cells.first;
    if (from.x >= to.x || from.y >= to.y || from.z >= to.z) continue;
    seen += elementCount(to - from);
    const Index3 tiles = layout_.brickTiles(brick.level, brick.brick);
    const Index3 first_tile = from / spec_.tile_cells;
    bool is_constant = true;
    forEachIndex({first_tile, BrickLayout::ceilDivide(to, spec_.tile_cells) - first_tile},
                 [&](const Index3& tile) {
                   is_constant =
                       is_constant &&
                       brick.is_constant[static_cast<std::size_t>(linearIndex(tile, tiles))];
                 });
    if (!is_constant) return false;
  }
  return seen == elementCount(end - first);
}

template <typename T>
void ErrorPass<T>::findChunk(const IndexBox& cells, std::deque<BrickErrors>& bricks) {
  const PhaseTimes::Timer timer(times_, BuildStep::kError);
  if (isConstant(cells, bricks)) return;
  thread_local ErrorChunk finder;
  finder.find(
      layout_.lattice(), bins_, values_, cells,
      [this](int level, const IndexBox& box, float* out) { written_.read(level, box, out); });
  for (BrickErrors& brick : bricks) includeCodes(finder.codes(brick.level), brick);
}

// Those of the brick's cells that the chunk has a say in.
template <typename T>
void ErrorPass<T>::includeCodes(const ErrorCodes& codes, BrickErrors& brick) const {
  const Index3 first = glm::max(codes.cells.first, brick.cells.first);
  const Index3 end = glm::min(codes.cells.end(), brick.cells.end());
  if (codes.bins == 0 || first.x >= end.x || first.y >= end.y || first.z >= end.z) return;
  const std::lock_guard lock(brick.mutex);
  const Index3 tiles = layout_.brickTiles(brick.level, brick.brick);
  const Index3 first_tile = (first - brick.cells.first) / spec_.tile_cells;
  const Index3 end_tile = BrickLayout::ceilDivide(end - brick.cells.first, spec_.tile_cells);
  auto* const bytes = reinterpret_cast<std::uint8_t*>(brick.part.bytes.data());
  forEachIndex({first_tile, end_tile - first_tile}, [&](const Index3& tile) {
    const auto n = static_cast<std::size_t>(linearIndex(tile, tiles));
    const Index3 begin = brick.cells.first + tile * spec_.tile_cells;
    const Index3 count = glm::min(Index3(spec_.tile_cells), brick.cells.end() - begin);
    const Index3 from = glm::max(begin, first), to = glm::min(begin + count, end);
    for (std::uint32_t bin = codes.first_bin; bin < codes.first_bin + codes.bins; ++bin) {
      if (!codes.isUsed(bin)) continue;
      std::uint8_t* const block =
          bytes + brick.offsets[n] +
          brick.tiles[n].blockOf(bin) * static_cast<std::size_t>(elementCount(count));
      const std::uint8_t* const source = codes.bin(bin);
      for (std::int64_t z = from.z; z < to.z; ++z)
        for (std::int64_t y = from.y; y < to.y; ++y) {
          const std::uint8_t* const codes_row =
              source + linearIndex(Index3(from.x, y, z) - codes.cells.first, codes.cells.count);
          std::uint8_t* const row = block + linearIndex(Index3(from.x, y, z) - begin, count);
          for (std::int64_t x = 0; x < to.x - from.x; ++x) row[x] = std::max(row[x], codes_row[x]);
        }
    }
  });
}

template <typename T>
void ErrorPass<T>::writeBricks(std::deque<BrickErrors>& bricks) {
  isolatedForEach(std::size_t{0}, bricks.size(), [&](std::size_t i) {
    const PhaseTimes::Timer timer(times_, BuildStep::kPack);
    encodeErrors(codec_, bricks[i].part);
  });
  const PhaseTimes::Timer timer(times_, BuildStep::kWrite);
  for (const BrickErrors& brick : bricks)
    writer_.writeError(written_.row(brick.level, brick.brick), brick.part, brick.elements);
}

#define ISOBRICK_INSTANTIATE(T) template class ErrorPass<T>;
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
