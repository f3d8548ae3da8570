#include "isobrick/preprocess/brick_stream.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <future>
#include <limits>
#include <mutex>

#include "isobrick/preprocess/brick_window.h"
#include "isobrick/preprocess/finite_voxels.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/kernels/tile_ranges.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/pyramid_file_builder.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/brick_supply.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {
namespace {

// All values that a voxel of the type may have, which bounds those of integers: normals are the
// same whatever the bounds, as long as squares of gradients fit floats. Floats need their own.
template <typename T>
constexpr ValueRange rangeOfType() {
  return {static_cast<float>(std::numeric_limits<T>::lowest()),
          static_cast<float>(std::numeric_limits<T>::max())};
}

// The bricks of a box of voxels, which changes: those that are at hand. T is the voxel type.
template <typename T>
class VoxelWindow final : public BrickSupply {
 public:
  explicit VoxelWindow(const BrickLayout& layout) : layout_(layout) {}

  // From now on the bricks are at hand whose sample boxes lie in `voxels`, which outlive their use.
  // Nobody may use the former bricks any more.
  void show(const SampleBlock<T>& voxels) { voxels_ = voxels; }
  // The range of all bricks that were asked for theirs.
  ValueRange seenRange() const {
    const std::lock_guard lock(mutex_);
    return seen_;
  }

  ValueRange range(const Index3& brick) const override {
    const IndexBox cells = layout_.brickCellBox(0, brick);
    const ValueRange range = rangeOfBlock(voxels_.part({cells.first, cells.count + Index3(1)}));
    const std::lock_guard lock(mutex_);
    seen_.include(range);
    return range;
  }
  void copyTileRanges(const Index3& brick, std::byte* out) const override {
    thread_local CubeRanges<T> tiles;
    tiles.reset(layout_.brickTiles(0, brick));
    includeClosedCubes(voxels_, layout_.brickCellBox(0, brick), layout_.tileCells(), tiles);
    T* pair = reinterpret_cast<T*>(out);
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      *pair++ = tiles.min[i];
      *pair++ = tiles.max[i];
    }
  }
  void copySamples(const Index3& brick, std::byte* out) const override {
    const IndexBox box = layout_.brickSampleBox(0, brick);
    copyBox(voxels_, box, reinterpret_cast<T*>(out), box);
  }

 private:
  const BrickLayout layout_;
  SampleBlock<T> voxels_;
  mutable std::mutex mutex_;  // guards all below
  mutable ValueRange seen_;
};

// Of a volume of which no pyramid is built: as a pyramid has it by default, without curvature.
PyramidSpec level0Spec(const VolumeInfo& info) {
  BuildOptions options;
  options.with_curvature = false;
  return pyramidSpecOf(info, options);
}

// The voxels that a window of bricks takes.
IndexBox samplesOf(const BrickLayout& layout, const IndexBox& bricks) {
  return unionOf(layout.brickSampleBox(0, bricks.first),
                 layout.brickSampleBox(0, bricks.end() - Index3(1)));
}

}  // namespace

// All but what depends on the voxel type.
class BrickStream::Run {
 public:
  Run(BrickStreamOptions options, std::unique_ptr<VolumeSource> source)
      : options_(std::move(options)),
        source_(std::move(source)),
        info_(source_->info()),
        layout_(level0Spec(info_).layout()),
        files_(source_->files()),
        stamps_(InputWatch::stampsOf(files_)) {}
  virtual ~Run() = default;

  bool fits() const { return planOf(allBricks()).has_value(); }
  const VolumeInfo& info() const { return info_; }
  const Pyramid& pyramid() const { return *pyramid_; }
  virtual void run(const IndexBox& bricks, const std::function<void(const IndexBox&)>& take) = 0;
  virtual ValueRange range() = 0;

 protected:
  // A source that is read in order is read from its beginning by a new one.
  void beginReading() {
    if (was_read_ && !source_->readsBoxes()) {
      source_ = options_.open();
      source_->chooseVoxelsAs(info_);
    }
    was_read_ = true;
  }
  void throwIfChanged() const {
    if (InputWatch::stampsOf(files_) != stamps_)
      throw fileError(info_.source, "'", info_.source, "' changed while it was read; do it again");
  }
  IndexBox allBricks() const { return {Index3(0), layout_.bricks(0)}; }
  std::size_t bytesOf(const IndexBox& box) const {
    return static_cast<std::size_t>(box.size()) * voxelBytes(info_.voxel_type);
  }

  // How a box of bricks is cut into windows, and how many of them are in memory at a time.
  // None if the memory does not suffice.
  struct Plan {
    BrickWindows windows;
    std::size_t buffers;
  };
  std::optional<Plan> planOf(const IndexBox& bricks) const {
    const std::uint64_t held = source_->bufferBytes();
    const std::uint64_t most =
        (options_.memory_bytes - std::min(held, options_.memory_bytes)) / 4 * 3;
    const auto fits = [&](std::int64_t x, std::int64_t y, std::size_t windows) {
      return windows * bytesOf(boxOf({bricks.first, Index3(x, y, 1)})) <= most;
    };
    const Index3 all = bricks.count;
    if (fits(all.x, all.y, 2)) return Plan{{bricks, all.x, all.y}, 2};
    if (!source_->readsBoxes() && fits(all.x, all.y, 1)) return Plan{{bricks, all.x, all.y}, 1};
    if (source_->readsBoxes()) {
      std::int64_t x = all.x, y = all.y;
      while (y > 1 && !fits(x, y, 2)) --y;
      while (x > 1 && !fits(x, y, 2)) --x;
      for (const std::size_t windows : {2, 1})
        if (fits(x, y, windows)) return Plan{{bricks, x, y}, windows};
    }
    return std::nullopt;
  }
  // The voxels that are read for these bricks: whole slices, if the source is read in order.
  IndexBox boxOf(const IndexBox& bricks) const {
    IndexBox box = samplesOf(layout_, bricks);
    if (!source_->readsBoxes()) {
      box.first = {0, 0, box.first.z};
      box.count = {info_.voxels.x, info_.voxels.y, box.count.z};
    }
    return box;
  }

  // Reads `box`, some rows or slices at a time, so that a request to cancel need not wait for all.
  void read(const IndexBox& box, std::byte* to) const {
    const std::int64_t rows = SliceSpool::rowsPerRead(info_);
    const IndexBox slice{box.first, {box.count.x, box.count.y, 1}};
    for (std::int64_t z = box.first.z; z < box.end().z; ++z)
      for (std::int64_t y = box.first.y; y < box.end().y; y += rows) {
        if (options_.cancel != nullptr) options_.cancel->check();
        const std::int64_t count = std::min(rows, slice.end().y - y);
        const IndexBox some{{box.first.x, y, z}, {box.count.x, count, 1}};
        if (source_->readsBoxes())
          source_->readBox(some, to);
        else
          source_->readRows(z * info_.voxels.y + y, count, to);
        to += bytesOf(some);
      }
  }

  const BrickStreamOptions options_;
  std::unique_ptr<VolumeSource> source_;
  const VolumeInfo info_;
  const BrickLayout layout_;
  std::unique_ptr<Pyramid> pyramid_;

 private:
  const std::vector<std::string> files_;
  const std::vector<InputWatch::Stamp> stamps_;
  bool was_read_ = false;
};

template <typename T>
class BrickStream::TypedRun final : public Run {
 public:
  TypedRun(BrickStreamOptions options, std::unique_ptr<VolumeSource> source)
      : Run(std::move(options), std::move(source)),
        window_(std::make_shared<VoxelWindow<T>>(layout_)) {
    ValueRange values = rangeOfType<T>();
    if (!fits()) return;
    if constexpr (std::is_same_v<T, float>) values = info_.bounds ? *info_.bounds : range();
    pyramid_ = std::make_unique<Pyramid>(info_.source, level0Spec(info_), values, window_);
  }

  void run(const IndexBox& bricks, const std::function<void(const IndexBox&)>& take) override {
    if (bricks.size() == 0) return;
    beginReading();
    const Plan plan = planOf(bricks).value();
    std::array<IndexBox, 2> boxes;  // of the voxels in the buffers
    const std::size_t bytes = bytesOfLargest(plan.windows);
    for (std::size_t i = 0; i < plan.buffers; ++i)
      if (buffers_[i].size() < bytes) buffers_[i] = LargeBuffer(bytes);
    const auto fill = [&](std::int64_t i) {
      const auto now = static_cast<std::size_t>(i) % plan.buffers;
      const auto before = (now + plan.buffers - 1) % plan.buffers;
      const IndexBox box = boxOf(plan.windows.window(i));
      if (i + 1 < plan.windows.count())
        source_->announce(std::array{box, boxOf(plan.windows.window(i + 1))});
      fillWindow(box, boxes[before], buffers_[before].data(), buffers_[now].data());
      boxes[now] = box;
    };
    std::future<void> next;  // waits for its thread when it goes
    fill(0);
    for (std::int64_t i = 0; i < plan.windows.count(); ++i) {
      if (next.valid())
        next.get();
      else if (i > 0)
        fill(i);
      const bool is_overlapped = plan.buffers > 1 && i + 1 < plan.windows.count();
      if (is_overlapped) next = std::async(std::launch::async, fill, i + 1);
      const auto now = static_cast<std::size_t>(i) % plan.buffers;
      window_->show(
          SampleBlock<T>::dense(reinterpret_cast<const T*>(buffers_[now].data()), boxes[now]));
      take(plan.windows.window(i));
    }
    throwIfChanged();
  }

  ValueRange range() override {
    if (!range_) range_ = rangeOfAll();
    return *range_;
  }

 private:
  std::size_t bytesOfLargest(const BrickWindows& windows) const {
    std::size_t bytes = 0;
    for (std::int64_t i = 0; i < windows.count(); ++i)
      bytes = std::max(bytes, bytesOf(boxOf(windows.window(i))));
    return bytes;
  }

  // Slices that the window before has are copied; a source that is read in order has passed them.
  void fillWindow(const IndexBox& box, const IndexBox& before, const std::byte* from,
                  std::byte* to) const {
    IndexBox rest = box;
    const IndexBox common = intersectionOf(box, before);
    const bool is_next_slab = common.size() > 0 && box.first.x == before.first.x &&
                              box.first.y == before.first.y && box.count.x == before.count.x &&
                              box.count.y == before.count.y;
    if (is_next_slab) {
      IndexBox passed = before;
      passed.count.z = common.first.z - before.first.z;
      std::memmove(to, from + bytesOf(passed), bytesOf(common));
      to += bytesOf(common);
      rest.first.z += common.count.z;
      rest.count.z -= common.count.z;
    }
    read(rest, to);
    if constexpr (std::is_same_v<T, float>) {
      if (!range_)  // otherwise a pass before this one did it
        requireFinite(SampleBlock<float>::dense(reinterpret_cast<const float*>(to), rest), info_);
    }
  }

  ValueRange rangeOfAll() {
    const IndexBox all = allBricks();
    double done = 0;
    run(all, [&](const IndexBox& bricks) {
      isolatedForEach(std::int64_t{0}, bricks.size(), [&](std::int64_t i) {
        static_cast<void>(window_->range(bricks.first + indexAt(i, bricks.count)));
      });
      done += static_cast<double>(bricks.size());
      if (options_.progress) options_.progress(done / static_cast<double>(all.size()));
    });
    return window_->seenRange();
  }

  const std::shared_ptr<VoxelWindow<T>> window_;
  std::array<LargeBuffer, 2> buffers_;
  std::optional<ValueRange> range_;  // of the whole volume, if it is known
};

BrickStream::BrickStream(BrickStreamOptions options) {
  std::unique_ptr<VolumeSource> source = options.open();
  source->chooseVoxels(options.cancel, options.progress);
  visitVoxelType(source->info().voxel_type, [&](auto tag) {
    run_ = std::make_unique<TypedRun<typename decltype(tag)::Type>>(std::move(options),
                                                                    std::move(source));
  });
}
BrickStream::~BrickStream() = default;

bool BrickStream::fits() const { return run_->fits(); }
const VolumeInfo& BrickStream::info() const { return run_->info(); }
const Pyramid& BrickStream::pyramid() const { return run_->pyramid(); }
void BrickStream::run(const IndexBox& bricks, const std::function<void(const IndexBox&)>& take) {
  run_->run(bricks, take);
}
ValueRange BrickStream::range() { return run_->range(); }

namespace {

template <typename T>
std::unique_ptr<const Pyramid> pyramidOf(const VolumeInfo& info, const VoxelArray& array) {
  const PyramidSpec spec = level0Spec(info);
  const SampleBlock<T> voxels{static_cast<const T*>(array.first),
                              {Index3(0), info.voxels},
                              array.row_stride,
                              array.slice_stride};
  const BrickLayout layout = spec.layout();
  const auto window = std::make_shared<VoxelWindow<T>>(layout);
  window->show(voxels);
  ValueRange values = rangeOfType<T>();
  if constexpr (std::is_same_v<T, float>) {
    isolatedForEach(std::int64_t{0}, elementCount(layout.bricks(0)), [&](std::int64_t i) {
      const Index3 brick = indexAt(i, layout.bricks(0));
      requireFinite(voxels.part(layout.brickOwnSamples(0, brick)), info);
      static_cast<void>(window->range(brick));
    });
    values = window->seenRange();
  }
  return std::make_unique<const Pyramid>(info.source, spec, values, window);
}

}  // namespace

std::unique_ptr<const Pyramid> pyramidOfArray(const VolumeInfo& info, const VoxelArray& array) {
  std::unique_ptr<const Pyramid> pyramid;
  visitVoxelType(info.voxel_type,
                 [&](auto tag) { pyramid = pyramidOf<typename decltype(tag)::Type>(info, array); });
  return pyramid;
}

}  // namespace isobrick
