#include "isobrick/extract/oracles/error_cells.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <span>

#include "isobrick/extract/kernels/field_bounds.h"
#include "isobrick/extract/oracles/cell_error.h"
#include "isobrick/extract/oracles/oracle_share.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

// A run of cells along one axis, both ends included.
struct CellRun {
  std::int64_t first, last;
};

// The voxels of a closed brick along one axis, and where level 1 has its samples among them. All is
// counted from the brick's first.
struct BrickAxis {
  std::int64_t voxels;

  std::int64_t coarseCells() const { return voxels / 2; }
  // An odd last voxel is the volume's last, and the thin last cell of level 1 ends there.
  bool isSample(std::int64_t voxel) const { return voxel % 2 == 0 || voxel == voxels - 1; }
  std::int64_t voxelOf(std::int64_t sample) const { return std::min(2 * sample, voxels - 1); }
  // Of level 1: what sits at the voxel, or on both sides of it.
  CellRun samplesAround(std::int64_t voxel) const {
    if (isSample(voxel)) return {(voxel + 1) / 2, (voxel + 1) / 2};
    return {voxel / 2, voxel / 2 + 1};
  }
  // Beyond the brick at its ends.
  CellRun cellsTouching(std::int64_t voxel) const {
    if (isSample(voxel)) return {(voxel + 1) / 2 - 1, (voxel + 1) / 2};
    return {voxel / 2, voxel / 2};
  }
};

}  // namespace

// T is the voxel type.
template <typename T>
class ErrorCells::Brick {
 public:
  Brick(ErrorCells& memory, const MeshContext& context, const Index3& brick,
        const ErrorBound& bound)
      : memory_(memory),
        bound_(bound),
        lattice_(context.lattice()),
        tile_cells_(context.pyramid.layout().tileCells()),
        tile_shift_(std::countr_zero(static_cast<std::uint64_t>(tile_cells_))),
        first_(context.pyramid.layout().brickCellBox(0, brick).first),
        samples_(context.samples(0, brick)),
        coarse_(context.samples(1, brick / std::int64_t{2})) {
    const Index3 cells = context.pyramid.layout().brickCellBox(0, brick).count;
    for (int axis = 0; axis < 3; ++axis) axes_[axis] = {cells[axis] + 1};
    // Rows are read past their ends, and x edges one voxel further.
    stride_ = axes_[0].voxels + 1 + kErrorLanes;
    for (auto& plane : memory_.planes_)
      plane.resize(static_cast<std::size_t>(3 * axes_[1].voxels * stride_));
    memory_.flags_.resize(static_cast<std::size_t>(stride_));
    ring_ =
        Index3(2) + Index3(axes_[0].coarseCells(), axes_[1].coarseCells(), axes_[2].coarseCells());
    memory_.cells_.assign(static_cast<std::size_t>(elementCount(ring_)), 0);
  }

  void run() {
    findRuns();
    for (auto& filled : memory_.is_filled_)
      filled.assign(static_cast<std::size_t>(axes_[1].voxels), 0);
    for (std::int64_t z = 0; z < axes_[2].voxels; ++z) {
      // The next plane takes the place of the one before.
      auto& next_filled = memory_.is_filled_[(z + 1) % 2];
      std::fill(next_filled.begin(), next_filled.end(), 0);
      for (std::int64_t y = 0; y < axes_[1].voxels; ++y) flagRow(y, z);
    }
  }

  // After run().
  FoundCells found() const {
    const IndexBox cells{first_ / std::int64_t{2}, ring_ - Index3(2)};
    FoundCells found{CellBits({cells.first - Index3(1), ring_}), CellBits(cells)};
    CellError<T> error(lattice_, samples_, coarse_, bound_);
    const IndexBox& ring = found.may_be_beyond.box();
    const std::uint8_t* is_marked = memory_.cells_.data();
    for (std::int64_t z = ring.first.z; z < ring.end().z; ++z)
      for (std::int64_t y = ring.first.y; y < ring.end().y; ++y, is_marked += ring_.x)
        forEachMark(is_marked, ring_.x, [&](std::int64_t x) {
          const Index3 cell(ring.first.x + x, y, z);
          found.may_be_beyond.add(cell);
          if (!contains(cells, cell)) return;
          error.load(cell);
          if (error.isCrossed() && error.isBeyondWithin(CellError<T>::kAllCorners))
            found.are_beyond.add(cell);
        });
    return found;
  }

 private:
  // The tiles that a voxel touches along an axis, and those that have the edge to the next one.
  CellRun tilesTouching(int axis, std::int64_t voxel) const {
    return {std::max<std::int64_t>(voxel - 1, 0) >> tile_shift_,
            std::min(voxel >> tile_shift_, memory_.tiles_.dims()[axis] - 1)};
  }
  CellRun tilesWithEdge(std::int64_t voxel) const {
    return {voxel >> tile_shift_, voxel >> tile_shift_};
  }

  // Tiles that a voxel or edge touches along an axis: one, or two beside each other. As a number.
  static std::int64_t touchedNumber(const CellRun& tiles) { return tiles.first + tiles.last; }
  static CellRun touchedOf(std::int64_t number) { return {number / 2, (number + 1) / 2}; }
  std::int64_t touchedNumbers(int axis) const { return 2 * memory_.tiles_.dims()[axis] - 1; }

  // Of a row that these rows of tiles touch, the runs of voxels in active tiles. They begin at even
  // voxels. A short gap is a part of a run, which costs more than some voxels: nothing crosses
  // there, or nobody asks.
  static constexpr std::int64_t kShortGap = 16;
  std::span<const VoxelRun> runsOf(const CellRun& ys, const CellRun& zs) const {
    const std::size_t* begin =
        memory_.first_runs_.data() + touchedNumbers(1) * touchedNumber(zs) + touchedNumber(ys);
    return {memory_.runs_.data() + begin[0], begin[1] - begin[0]};
  }

  void findRuns() {
    memory_.runs_.clear();
    memory_.first_runs_.assign(1, 0);
    for (std::int64_t z = 0; z < touchedNumbers(2); ++z)
      for (std::int64_t y = 0; y < touchedNumbers(1); ++y) {
        addRuns(touchedOf(y), touchedOf(z));
        memory_.first_runs_.push_back(memory_.runs_.size());
      }
  }

  void addRuns(const CellRun& ys, const CellRun& zs) {
    const ActiveTiles& tiles = memory_.tiles_;
    std::vector<std::uint8_t>& is_active = memory_.active_row_;
    is_active.assign(static_cast<std::size_t>(tiles.dims().x), 0);
    bool is_any = false;
    for (std::int64_t z = zs.first; z <= zs.last; ++z)
      for (std::int64_t y = ys.first; y <= ys.last; ++y) {
        const ActiveTiles::Span span = tiles.activeSpan(y, z);
        is_any = is_any || span.end > 0;
        for (std::int64_t x = span.begin; x < span.end; ++x)
          if (tiles.isActive({x, y, z})) is_active[static_cast<std::size_t>(x)] = 1;
      }
    if (!is_any) return;
    std::vector<VoxelRun>& runs = memory_.runs_;
    const std::size_t before = runs.size();
    forEachMark(is_active.data(), tiles.dims().x, [&](std::int64_t x) {
      const std::int64_t first = x << tile_shift_;
      const std::int64_t last = std::min(first + tile_cells_, axes_[0].voxels - 1);
      if (runs.size() > before && first - runs.back().last <= kShortGap)
        runs.back().last = last;
      else
        runs.push_back({first, last});
    });
  }

  // The row's values and bounds in active tiles, made when they are first asked for.
  BoundedRow row(std::int64_t y, std::int64_t z) {
    float* value = memory_.planes_[z % 2].data() + 3 * y * stride_;
    float* low = value + stride_;
    float* high = low + stride_;
    std::uint8_t& is_filled = memory_.is_filled_[z % 2][static_cast<std::size_t>(y)];
    if (is_filled == 0) {
      is_filled = 1;
      for (const VoxelRun& run : runsOf(tilesTouching(1, y), tilesTouching(2, z)))
        fill(run, y, z, value, low, high);
    }
    return {value, low, high};
  }

  const T* voxelRow(std::int64_t y, std::int64_t z) const {
    return samples_.data<T>() +
           linearIndex(first_ + Index3(0, y, z) - samples_.box.first, samples_.box.count);
  }

  void fill(const VoxelRun& run, std::int64_t y, std::int64_t z, float* value, float* low,
            float* high) {
    SampleRows<T> around;
    around.last_voxel = axes_[0].voxels - 1;
    const CellRun ys = axes_[1].samplesAround(y), zs = axes_[2].samplesAround(z);
    for (std::int64_t k = zs.first; k <= zs.last; ++k)
      for (std::int64_t j = ys.first; j <= ys.last; ++j, ++around.count) {
        around.voxels[around.count] = voxelRow(axes_[1].voxelOf(j), axes_[2].voxelOf(k));
        around.samples[around.count] =
            coarse_.data<T>() +
            linearIndex(first_ / std::int64_t{2} + Index3(0, j, k) - coarse_.box.first,
                        coarse_.box.count);
      }
    boundField(around, voxelRow(y, z), run.first, run.last, value, low, high);
  }

  void flagRow(std::int64_t y, std::int64_t z) {
    const CellRun ys = tilesTouching(1, y), zs = tilesTouching(2, z);
    const std::span<const VoxelRun> runs = runsOf(ys, zs);
    if (runs.empty()) return;
    const BoundedRow here = row(y, z);
    for (const VoxelRun& run : runs) {
      flagVoxels(from(here, run.first), run.count(), bound_, clearFlags(run));
      forEachFlag(run, [&](std::int64_t x, unsigned) {
        mark(axes_[0].cellsTouching(x), axes_[1].cellsTouching(y), axes_[2].cellsTouching(z));
      });
      flagEdgesAlong(0, {0, y, z}, here, from(here, 1), {run.first, run.last - 1});
    }
    if (y + 1 < axes_[1].voxels) {
      for (const VoxelRun& run : runsOf(tilesWithEdge(y), zs))
        flagEdgesAlong(1, {0, y, z}, here, row(y + 1, z), run);
    }
    if (z + 1 < axes_[2].voxels) {
      for (const VoxelRun& run : runsOf(ys, tilesWithEdge(z)))
        flagEdgesAlong(2, {0, y, z}, here, row(y, z + 1), run);
    }
  }

  void flagEdgesAlong(int axis, Index3 at, const BoundedRow& here, const BoundedRow& other,
                      const VoxelRun& run) {
    flagEdges(from(here, run.first), from(other, run.first), run.count(), bound_, clearFlags(run));
    forEachFlag(run, [&](std::int64_t x, unsigned flags) {
      at.x = x;
      if ((flags & kCoarseEdge) != 0) markBeside(axis, at, at[axis] / 2);
      if ((flags & kLowHangs) != 0 && hangs(axis, at)) markBeside(axis, at, (at[axis] + 1) / 2 - 1);
      Index3 high = at;
      ++high[axis];
      if ((flags & kHighHangs) != 0 && hangs(axis, high))
        markBeside(axis, high, (high[axis] + 1) / 2);
    });
  }

  static BoundedRow from(const BoundedRow& row, std::int64_t voxel) {
    return {row.value + voxel, row.low + voxel, row.high + voxel};
  }

  // Whether the end of an edge along `axis` may hang on a coarse cell that the edge leads away
  // from.
  bool hangs(int axis, const Index3& voxel) const {
    if (!axes_[axis].isSample(voxel[axis])) return false;
    return !(axes_[0].isSample(voxel.x) && axes_[1].isSample(voxel.y) &&
             axes_[2].isSample(voxel.z));
  }

  // The coarse cells that touch the voxel, of those with the number `cell` along `axis`.
  void markBeside(int axis, const Index3& voxel, std::int64_t cell) {
    CellRun runs[3];
    for (int other = 0; other < 3; ++other)
      runs[other] = other == axis ? CellRun{cell, cell} : axes_[other].cellsTouching(voxel[other]);
    mark(runs[0], runs[1], runs[2]);
  }

  void mark(const CellRun& xs, const CellRun& ys, const CellRun& zs) {
    for (std::int64_t z = zs.first; z <= zs.last; ++z)
      for (std::int64_t y = ys.first; y <= ys.last; ++y)
        for (std::int64_t x = xs.first; x <= xs.last; ++x)
          memory_.cells_[static_cast<std::size_t>(linearIndex({x + 1, y + 1, z + 1}, ring_))] = 1;
  }

  // As many as the run has voxels, in whole eights.
  std::uint8_t* clearFlags(const VoxelRun& run) {
    std::fill_n(memory_.flags_.begin(), (run.count() + 7) / 8 * 8, std::uint8_t{0});
    return memory_.flags_.data();
  }

  template <typename F>
  void forEachFlag(const VoxelRun& run, F&& f) {
    const std::uint8_t* flags = memory_.flags_.data();
    forEachMark(flags, run.count(), [&](std::int64_t i) { f(run.first + i, flags[i]); });
  }

  // Of `count` bytes those that are not 0. Nearly all are: they are passed over eight at a time.
  template <typename F>
  static void forEachMark(const std::uint8_t* marks, std::int64_t count, F&& f) {
    for (std::int64_t begin = 0; begin < count; begin += 8) {
      std::uint64_t eight = 0;
      std::memcpy(&eight, marks + begin,
                  static_cast<std::size_t>(std::min<std::int64_t>(8, count - begin)));
      if (eight == 0) continue;
      for (std::int64_t i = begin; i < std::min(begin + 8, count); ++i)
        if (marks[i] != 0) f(i);
    }
  }

  ErrorCells& memory_;
  const ErrorBound& bound_;
  const Lattice& lattice_;
  const std::int64_t tile_cells_;
  const int tile_shift_;  // tiles have 2^that cells
  const Index3 first_;    // voxel
  const BrickSamples samples_, coarse_;
  BrickAxis axes_[3];
  std::int64_t stride_ = 0;
  Index3 ring_{0};
};

FoundCells ErrorCells::find(const MeshContext& context, const Index3& brick,
                            const ErrorBound& bound,
                            const std::function<bool(const Index3&)>& wants) {
  if (context.query.cull_by_ranges &&
      !context.pyramid.brickRange(0, brick).crosses(context.isovalue))
    return {};
  if (!tiles_.load(context, 0, brick)) return {};
  // What concerns a wanted cell lies in the closed cells of level 2 that touch it.
  const BrickLayout& layout = context.pyramid.layout();
  const IndexBox voxel_cells = layout.brickCellBox(0, brick);
  const bool is_any_wanted = tiles_.keepWhere([&](const Index3& tile) {
    const Index3 first = voxel_cells.first + tile * layout.tileCells();
    const Index3 last = glm::min(first + Index3(layout.tileCells()), voxel_cells.end()) - Index3(1);
    bool is_wanted = false;
    forEachIndex(
        {first / std::int64_t{4}, last / std::int64_t{4} - first / std::int64_t{4} + Index3(1)},
        [&](const Index3& cell) { is_wanted = is_wanted || wants(cell); });
    return is_wanted;
  });
  if (!is_any_wanted) return {};
  FoundCells found;
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    Brick<typename decltype(tag)::Type> voxels(*this, context, brick, bound);
    voxels.run();
    found = voxels.found();
  });
  context.throwIfReadsFailed();
  return found;
}

}  // namespace isobrick
