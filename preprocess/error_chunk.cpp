#include "isobrick/preprocess/error_chunk.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

constexpr auto kAllRuns = static_cast<RunBits>(-1);
static_assert(ErrorChunk::kMostCells.x / kErrorRun + 1 <= std::numeric_limits<RunBits>::digits);
static_assert(kErrorRun % ErrorChunk::kAlignment == 0);

// Cells of `level` in a closed box of voxels whose ends are ends of such cells.
IndexBox cellsIn(const IndexBox& voxels, int level) {
  const std::int64_t step = std::int64_t{1} << level;
  const Index3 first = voxels.first / step;
  return {first, BrickLayout::ceilDivide(voxels.end() - Index3(1), step) - first};
}

// Of cells that `codes` has too.
void includeCodes(const ErrorCodes& other, ErrorCodes& codes) {
  const Index3 offset = other.cells.first - codes.cells.first;
  for (std::uint32_t bin = other.first_bin; bin < other.first_bin + other.bins; ++bin) {
    if (!other.isUsed(bin)) continue;
    codes.use(bin);
    const std::uint8_t* from = other.bin(bin);
    for (std::int64_t z = 0; z < other.cells.count.z; ++z)
      for (std::int64_t y = 0; y < other.cells.count.y; ++y, from += other.cells.count.x)
        includeGreater(from, 0, 1, other.cells.count.x,
                       codes.bin(bin) + linearIndex(offset + Index3(0, y, z), codes.cells.count));
  }
}

// The cells that touch cell c, itself or its children among them, along one axis: those from
// scale * c + first to scale * c + last.
struct Touching {
  std::int64_t scale, first, last;
};
constexpr Touching kNeighbours = {1, -1, 1};
constexpr Touching kFiner = {2, -1, 2};

// The greatest codes of the cells that touch others along an axis. Cells are `length` codes wide:
// a slice, or a row of a slice.
void greatestOfRows(const Touching& touching, const std::uint8_t* from, std::int64_t from_first,
                    std::int64_t from_count, std::int64_t first, std::int64_t count,
                    std::int64_t length, std::uint8_t* to) {
  for (std::int64_t i = 0; i < count; ++i) {
    const std::int64_t cell = touching.scale * (first + i) - from_first;
    const std::int64_t begin = std::max(cell + touching.first, std::int64_t{0});
    const std::int64_t end = std::min(cell + touching.last + 1, from_count);
    includeGreater(from + begin * length, length, end - begin, length, to + i * length);
  }
}

// The same where the cells of a row touch each other.
void greatestOfCells(const Touching& touching, const std::uint8_t* from, std::int64_t from_first,
                     std::int64_t from_count, std::int64_t first, std::int64_t count,
                     std::vector<std::uint8_t>& scratch, std::uint8_t* to) {
  constexpr std::int64_t kPadding = 8;
  const std::int64_t size = from_count + 2 * kPadding;
  scratch.assign(static_cast<std::size_t>(2 * size), 0);
  std::uint8_t* const padded = scratch.data();
  std::uint8_t* const greatest = padded + size;  // of the run of cells that begins there
  std::copy_n(from, from_count, padded + kPadding);
  const std::int64_t taps = touching.last - touching.first + 1;
  includeGreater(padded, 1, taps, size - taps, greatest);
  const std::int64_t begin = touching.scale * first + touching.first - from_first + kPadding;
  for (std::int64_t x = 0; x < count; ++x) to[x] = greatest[begin + touching.scale * x];
}

// The same along one axis of all cells.
void greatestAlong(int axis, std::int64_t first, std::int64_t count, const Touching& touching,
                   const ErrorCodes& from, ErrorCodes& to) {
  IndexBox box = from.cells;
  box.first[axis] = first;
  box.count[axis] = count;
  to.reset(box, from.first_bin, from.bins);
  const std::int64_t from_first = from.cells.first[axis], from_count = from.cells.count[axis];
  // What lies along the lower axes is one row, the rest are rows of its own.
  std::int64_t length = 1, rows = 1;
  for (int k = 0; k < axis; ++k) length *= box.count[k];
  for (int k = axis + 1; k < 3; ++k) rows *= box.count[k];
  std::vector<std::uint8_t> scratch;
  for (std::uint32_t bin = from.first_bin; bin < from.first_bin + from.bins; ++bin) {
    if (!from.isUsed(bin)) continue;
    to.use(bin);
    const std::uint8_t* source = from.bin(bin);
    std::uint8_t* target = to.bin(bin);
    for (std::int64_t row = 0; row < rows; ++row) {
      if (axis == 0)
        greatestOfCells(touching, source, from_first, from_count, first, count, scratch, target);
      else
        greatestOfRows(touching, source, from_first, from_count, first, count, length, target);
      source += from_count * length;
      target += count * length;
    }
  }
}

void greatestTouching(const IndexBox& cells, const Touching& touching, const ErrorCodes& from,
                      ErrorCodes (&scratch)[2], ErrorCodes& to) {
  greatestAlong(2, cells.first.z, cells.count.z, touching, from, scratch[0]);
  greatestAlong(1, cells.first.y, cells.count.y, touching, scratch[0], scratch[1]);
  greatestAlong(0, cells.first.x, cells.count.x, touching, scratch[1], to);
}

// Writes a bound at the voxels of a run of cells of 2^kLevel voxels, the last one maybe thinner.
template <int kLevel>
void spread(const float* at_samples, std::int64_t voxels, float* out) {
  constexpr std::int64_t kStep = std::int64_t{1} << kLevel;
  constexpr float kShare = 1.0f / kStep;
  const std::int64_t whole = (voxels - 1) / kStep;
  for (std::int64_t cell = 0; cell < whole; ++cell) {
    const float from = at_samples[cell], slope = (at_samples[cell + 1] - from) * kShare;
    for (std::int64_t i = 0; i < kStep; ++i)
      out[cell * kStep + i] = from + static_cast<float>(i) * slope;
  }
  const std::int64_t begin = whole * kStep, rest = voxels - 1 - begin;
  out[begin] = at_samples[whole];
  if (rest == 0) return;
  const float slope = (at_samples[whole + 1] - at_samples[whole]) / static_cast<float>(rest);
  for (std::int64_t i = 0; i <= rest; ++i)
    out[begin + i] = at_samples[whole] + static_cast<float>(i) * slope;
}

void spread(int level, const float* at_samples, std::int64_t voxels, float* out) {
  switch (level) {
    case 0:
      return spread<0>(at_samples, voxels, out);
    case 1:
      return spread<1>(at_samples, voxels, out);
    case 2:
      return spread<2>(at_samples, voxels, out);
    default:
      return spread<3>(at_samples, voxels, out);
  }
}
static_assert(kMostErrorLevel == 3);

// Where a sample lies among those of the next coarser level along an axis: between two, or at one.
struct CoarsePlace {
  std::int64_t sample[2];
  float weight[2];

  bool hangs() const { return sample[0] != sample[1]; }
};
CoarsePlace coarsePlaceOf(const Lattice& lattice, int level, int axis, std::int64_t at) {
  const std::int64_t lower = at / 2, upper = (at + 1) / 2;
  if (lower == upper || at == lattice.samples(level)[axis] - 1) return {{upper, upper}, {1, 0}};
  const auto from = lattice.position(level + 1, axis, lower);
  const auto to = lattice.position(level + 1, axis, upper);
  const float share =
      static_cast<float>(lattice.position(level, axis, at) - from) / static_cast<float>(to - from);
  return {{lower, upper}, {1 - share, share}};
}

}  // namespace

void ErrorCodes::reset(const IndexBox& box, std::uint32_t first, std::uint32_t count) {
  cells = box;
  first_bin = first;
  bins = count;
  codes.assign(count * static_cast<std::size_t>(box.size()), 0);
  is_used.assign(count, 0);
}

void ErrorChunk::find(const Lattice& lattice, const ErrorBins& bins, const ValueRange& values,
                      const IndexBox& cells, const Read& read) {
  lattice_ = &lattice;
  bins_ = bins;
  voxels_ = {cells.first, cells.count + Index3(1)};
  // What single precision may change: everything is made of a few operations on such values.
  slack_ = 0x1p-18f * std::max(std::abs(values.min), std::abs(values.max));
  for (int level = 0; level <= bins.last_level; ++level) {
    Field& field = samples_[level];
    field.box = cellsIn(voxels_, level);
    field.box.count += Index3(1);
    field.values.resize(static_cast<std::size_t>(field.box.size() + kErrorRowPadding));
    read(level, field.box, field.values.data());
    std::fill_n(field.values.begin() + field.box.size(), kErrorRowPadding, 0.0f);
  }
  const ValueRange range = findSilentRuns();
  // Bounds are a slack wider than samples.
  first_bin_ = bins.binOf(static_cast<double>(range.min - 3 * slack_));
  bin_count_ = bins.binOf(static_cast<double>(range.max + 3 * slack_)) - first_bin_ + 1;
  const auto cellsAround = [&](int level) {
    const IndexBox inside = cellsIn(voxels_, level);
    const Index3 first = glm::max(inside.first - Index3(1), Index3(0));
    return IndexBox{first, glm::min(inside.end() + Index3(1), lattice.cells(level)) - first};
  };
  if (range.min == range.max) {
    for (int level = kFirstErrorLevel; level <= bins.last_level; ++level)
      found_[level - kFirstErrorLevel].reset(cellsAround(level), first_bin_, 0);
    return;
  }
  bin_ends_.clear();
  for (std::uint32_t bin = first_bin_; bin < first_bin_ + bin_count_; ++bin)
    bin_ends_.push_back(static_cast<float>(bins.least(bin)));
  bin_ends_.front() = -std::numeric_limits<float>::infinity();
  bin_ends_.push_back(std::numeric_limits<float>::infinity());

  for (int level = 1; level <= bins.last_level; ++level) boundOwn(level);
  ErrorCodes& level2 = found_[0];
  // What touches cells of level 1 that touch a cell of level 2 lies in those that touch it.
  run(0, Corners::kHanging, 2, hanging_codes_);
  greatestTouching(cellsAround(2), kNeighbours, hanging_codes_, touching_, level2);
  boundHanging(1);
  run(1, Corners::kHanging, 1, hanging_codes_);
  greatestTouching(cellsAround(2), kFiner, hanging_codes_, touching_, spread_codes_);
  includeCodes(spread_codes_, level2);
  run(2, Corners::kOwn, 2, own_codes_);
  includeCodes(own_codes_, level2);
  if (bins.last_level == 2) return;

  boundHanging(2);
  run(2, Corners::kHanging, 2, hanging_codes_);
  spread_codes_ = level2;
  includeCodes(hanging_codes_, spread_codes_);
  ErrorCodes& level3 = found_[1];
  greatestTouching(cellsAround(3), kFiner, spread_codes_, touching_, level3);
  run(3, Corners::kOwn, 3, own_codes_);
  includeCodes(own_codes_, level3);
}

// A run of voxels has no errors where the blocks that hold it and the edges from it are constant on
// all levels.
ValueRange ErrorChunk::findSilentRuns() {
  const Index3 blocks = BrickLayout::ceilDivide(voxels_.count - Index3(1), kAlignment);
  block_rows_ = {blocks.y, blocks.z};
  silent_runs_.assign(static_cast<std::size_t>(blocks.y * blocks.z), 0);
  ValueRange range;
  const auto width = static_cast<std::size_t>(voxels_.count.x);
  std::vector<ValueRange> in_row(static_cast<std::size_t>(blocks.x));
  std::vector<float> least(width), greatest(width);
  for (std::int64_t z = 0; z < blocks.z; ++z)
    for (std::int64_t y = 0; y < blocks.y; ++y) {
      in_row.assign(in_row.size(), {});
      for (int level = 0; level <= bins_.last_level; ++level) {
        const Field& field = samples_[level];
        const std::int64_t edge = kAlignment >> level;
        const Index3 last = field.box.count - Index3(1);
        const float* const values = field.values.data();
        least.assign(width, values[0]);
        greatest.assign(width, values[0]);
        const auto rowAt = [&](std::int64_t j, std::int64_t k) {
          return values + linearIndex(Index3(0, j, k), field.box.count);
        };
        std::copy_n(rowAt(y * edge, z * edge), field.box.count.x, least.data());
        std::copy_n(rowAt(y * edge, z * edge), field.box.count.x, greatest.data());
        for (std::int64_t k = z * edge; k <= std::min((z + 1) * edge, last.z); ++k)
          for (std::int64_t j = y * edge; j <= std::min((y + 1) * edge, last.y); ++j)
            includeRange(rowAt(j, k), field.box.count.x, least.data(), greatest.data());
        for (std::int64_t x = 0; x < blocks.x; ++x)
          for (std::int64_t i = x * edge; i <= std::min((x + 1) * edge, last.x); ++i) {
            const auto at = static_cast<std::size_t>(i);
            in_row[static_cast<std::size_t>(x)].include({least[at], greatest[at]});
          }
      }
      RunBits& silent = silent_runs_[static_cast<std::size_t>(z * blocks.y + y)];
      silent = kAllRuns;
      for (std::int64_t x = 0; x < blocks.x; ++x) {
        const ValueRange& block = in_row[static_cast<std::size_t>(x)];
        range.include(block);
        if (block.min >= block.max) continue;
        const std::int64_t first = x * kAlignment;
        silent = static_cast<RunBits>(silent & ~(1 << (first / kErrorRun)));
        // The last voxel of a row may be a run of its own.
        if (x + 1 == blocks.x)
          silent = static_cast<RunBits>(silent & ~(1 << ((voxels_.count.x - 1) / kErrorRun)));
      }
    }
  return range;
}

// At each sample of the level the lesser and the greater of it and of that of the next finer one.
void ErrorChunk::boundOwn(int level) {
  const Field& coarse = samples_[level];
  const Field& fine = samples_[level - 1];
  Bounds& bounds = own_[level];
  bounds.low.box = bounds.high.box = coarse.box;
  bounds.low.values.resize(coarse.values.size());
  bounds.high.values.resize(coarse.values.size());
  const Index3 last_fine = lattice_->samples(level - 1) - Index3(1);
  const std::int64_t last_x = last_fine.x - fine.box.first.x;
  std::size_t i = 0;
  for (std::int64_t z = coarse.box.first.z; z < coarse.box.end().z; ++z)
    for (std::int64_t y = coarse.box.first.y; y < coarse.box.end().y; ++y) {
      const float* const row = fine.row(std::min(2 * y, last_fine.y), std::min(2 * z, last_fine.z));
      for (std::int64_t x = 0; x < coarse.box.count.x; ++x, ++i) {
        const float a = coarse.values[i], b = row[std::min(2 * x, last_x)];
        bounds.low.values[i] = std::min(a, b);
        bounds.high.values[i] = std::max(a, b);
      }
    }
}

// The same, and what a sample may get that hangs on an edge or a face of the next coarser level.
void ErrorChunk::boundHanging(int level) {
  const Field& own_low = own_[level].low;
  const Field& own_high = own_[level].high;
  const Bounds& coarse = own_[level + 1];
  const IndexBox& box = hanging_.low.box = hanging_.high.box = own_low.box;
  const auto size = static_cast<std::size_t>(box.size());
  hanging_.low.values.resize(size);
  hanging_.high.values.resize(size);
  std::vector<CoarsePlace> places[3];
  for (int axis = 0; axis < 3; ++axis)
    for (std::int64_t at = box.first[axis]; at < box.end()[axis]; ++at)
      places[axis].push_back(coarsePlaceOf(*lattice_, level, axis, at));

  std::size_t i = 0;
  for (const CoarsePlace& z : places[2])
    for (const CoarsePlace& y : places[1]) {
      // The rows of coarser samples around this one.
      struct Row {
        const float *low, *high;
        float y_weight, z_weight;
      };
      Row rows[4];
      int row_count = 0;
      for (int k = 0; k < (z.hangs() ? 2 : 1); ++k)
        for (int j = 0; j < (y.hangs() ? 2 : 1); ++j) {
          const Index3 first(coarse.low.box.first.x, y.sample[j], z.sample[k]);
          const std::int64_t offset =
              linearIndex(first - coarse.low.box.first, coarse.low.box.count) - first.x;
          rows[row_count++] = {coarse.low.values.data() + offset,
                               coarse.high.values.data() + offset, y.weight[j], z.weight[k]};
        }
      for (const CoarsePlace& x : places[0]) {
        float low = own_low.values[i], high = own_high.values[i];
        const int hanging = (x.hangs() ? 1 : 0) + (y.hangs() ? 1 : 0) + (z.hangs() ? 1 : 0);
        if (hanging == 1 || hanging == 2) {
          float mean_low = 0, mean_high = 0;
          for (int row = 0; row < row_count; ++row)
            for (int side = 0; side < (x.hangs() ? 2 : 1); ++side) {
              const float weight = x.weight[side] * rows[row].y_weight * rows[row].z_weight;
              mean_low += weight * rows[row].low[x.sample[side]];
              mean_high += weight * rows[row].high[x.sample[side]];
            }
          low = std::min(low, mean_low);
          high = std::max(high, mean_high);
        }
        hanging_.low.values[i] = low;
        hanging_.high.values[i] = high;
        ++i;
      }
    }
}

// One pass over the voxels, plane by plane.
class ErrorChunk::Run {
 public:
  Run(ErrorChunk& chunk, int level, Corners corners, int cell_level, ErrorCodes& out)
      : chunk_(chunk),
        // What hangs on level 1 lies on level 0: its bounds are between those of level 1.
        is_of_voxels_(level == 0),
        level_(std::max(level, 1)),
        cell_level_(cell_level),
        bounds_(corners == Corners::kOwn || is_of_voxels_ ? chunk.own_[level_] : chunk.hanging_),
        voxels_(chunk.voxels_),
        samples_(bounds_.low.box),
        cells_(cellsIn(voxels_, cell_level)),
        stride_(errorRowStride(voxels_.count.x)),
        runs_((voxels_.count.x + kErrorRun - 1) / kErrorRun),
        bins_{chunk.bin_ends_.data(), static_cast<std::int64_t>(chunk.bin_count_)},
        out_(out) {
    out.reset(cells_, chunk.first_bin_, chunk.bin_count_);
    for (Plane& plane : chunk.planes_) resize(plane, voxels_.count.y);
    for (Plane& plane : chunk.sample_planes_) resize(plane, samples_.count.y);
    resize(chunk.between_planes_, samples_.count.y);
    const auto rows = static_cast<std::size_t>(2 * cells_.count.y * bins_.count);
    chunk.greatest_.assign(rows * static_cast<std::size_t>(stride_), 0.0f);
    chunk.touched_.assign(rows, 0);
    const std::int64_t step = std::int64_t{1} << cell_level;
    for (std::int64_t x = 0; x < kAlignment + kErrorRun; ++x)
      is_end_[x] = x % step == 0 ? 1.0f : 0.0f;
    if (!is_of_voxels_) return;
    for (int others = 0; others < 3; ++others) {
      is_between_[others].assign(static_cast<std::size_t>(stride_), 0.0f);
      for (std::int64_t x = 0; x < voxels_.count.x; ++x) {
        const int hanging = others + (hangs(0, voxels_.first.x + x) ? 1 : 0);
        is_between_[others][static_cast<std::size_t>(x)] = hanging == 1 || hanging == 2 ? 1 : 0;
      }
    }
  }

  void operator()() {
    const std::int64_t last = voxels_.end().z - 1;
    fill(voxels_.first.z);
    for (std::int64_t z = voxels_.first.z; z <= last; ++z) {
      if (z < last) fill(z + 1);
      for (std::int64_t y = voxels_.first.y; y < voxels_.end().y; ++y) findIn(y, z);
      // The layer below is complete.
      if (z > voxels_.first.z && (z == last || isEnd(z))) encode((z - 1) >> cell_level_);
    }
  }

 private:
  void resize(Plane& plane, std::int64_t rows) const {
    plane.low.resize(static_cast<std::size_t>(rows * stride_));
    plane.high.resize(static_cast<std::size_t>(rows * stride_));
    plane.bins.resize(static_cast<std::size_t>(rows * runs_));
  }
  bool isEnd(std::int64_t voxel) const {
    return (voxel & ((std::int64_t{1} << cell_level_) - 1)) == 0;
  }
  // Whether a voxel is no sample of level 1 along an axis.
  bool hangs(int axis, std::int64_t voxel) const {
    return voxel % 2 != 0 && voxel != chunk_.lattice_->voxels()[axis] - 1;
  }

  // The bounds at the voxels of a row in a plane of samples, of all its rows.
  const Plane& samplePlane(std::int64_t z) {
    Plane& plane = chunk_.sample_planes_[z % 2];
    if (plane_of_[z % 2] == z) return plane;
    plane_of_[z % 2] = z;
    for (std::int64_t y = 0; y < samples_.count.y; ++y) {
      const std::int64_t sample_y = samples_.first.y + y;
      spread(level_, bounds_.low.row(sample_y, z), voxels_.count.x, plane.low.data() + y * stride_);
      spread(level_, bounds_.high.row(sample_y, z), voxels_.count.x,
             plane.high.data() + y * stride_);
    }
    return plane;
  }

  // The bounds of a plane of voxels, between those of two planes of samples.
  void fill(std::int64_t z) {
    const Share zs = shareOf(2, z);
    const Plane* from = &samplePlane(zs.sample);
    if (zs.of_upper > 0) {
      const Plane& to = samplePlane(zs.sample + 1);
      Plane& between = chunk_.between_planes_;
      const std::int64_t count = samples_.count.y * stride_;
      interpolateRow(from->low.data(), to.low.data(), zs.of_upper, count, between.low.data());
      interpolateRow(from->high.data(), to.high.data(), zs.of_upper, count, between.high.data());
      from = &between;
    }
    Plane& plane = chunk_.planes_[z % 2];
    for (std::int64_t y = voxels_.first.y; y < voxels_.end().y; ++y) {
      // Nobody looks at a silent row beside silent ones.
      if (chunk_.silentRuns(y, z) == kAllRuns &&
          chunk_.silentRuns(std::max(y - 1, voxels_.first.y), z) == kAllRuns &&
          chunk_.silentRuns(y, std::max(z - 1, voxels_.first.z)) == kAllRuns)
        continue;
      const Share ys = shareOf(1, y);
      const std::int64_t lower = (ys.sample - samples_.first.y) * stride_;
      const std::int64_t upper = ys.of_upper > 0 ? lower + stride_ : lower;
      const std::int64_t row = y - voxels_.first.y;
      const int others = (hangs(1, y) ? 1 : 0) + (hangs(2, z) ? 1 : 0);
      boundRow({from->low.data() + lower, from->low.data() + upper, from->high.data() + lower,
                from->high.data() + upper, ys.of_upper, chunk_.slack_,
                is_of_voxels_ ? is_between_[others].data() : nullptr},
               chunk_.samples_[0].row(y, z), voxels_.count.x, bins_,
               plane.low.data() + row * stride_, plane.high.data() + row * stride_,
               plane.bins.data() + row * runs_);
    }
  }

  // The sample of the level at or below a voxel, and how far the voxel is on the way to the next.
  struct Share {
    std::int64_t sample;
    float of_upper;
  };
  Share shareOf(int axis, std::int64_t voxel) const {
    const Lattice& lattice = *chunk_.lattice_;
    if (voxel == lattice.voxels()[axis] - 1) return {lattice.cells(level_)[axis], 0};
    const std::int64_t sample = voxel >> level_;
    const std::int64_t from = lattice.position(level_, axis, sample);
    const std::int64_t to = lattice.position(level_, axis, sample + 1);
    return {sample, static_cast<float>(voxel - from) / static_cast<float>(to - from)};
  }

  BracketedRow row(std::int64_t y, std::int64_t z) const {
    const Plane& plane = chunk_.planes_[z % 2];
    const std::int64_t number = y - voxels_.first.y;
    return {chunk_.samples_[0].row(y, z), plane.low.data() + number * stride_,
            plane.high.data() + number * stride_, plane.bins.data() + number * runs_};
  }
  void findIn(std::int64_t y, std::int64_t z) {
    const RunBits silent = chunk_.silentRuns(y, z);
    if (silent == kAllRuns) return;
    const bool has_y = y + 1 < voxels_.end().y, has_z = z + 1 < voxels_.end().z;
    includeErrorsOfRow(row(y, z), has_y ? row(y + 1, z) : BracketedRow{},
                       has_z ? row(y, z + 1) : BracketedRow{}, voxels_.count.x, bins_,
                       targetsOf(y, z, has_y, has_z, silent));
  }

  // The rows of cells that hold a row of voxels.
  ErrorTargets targetsOf(std::int64_t y, std::int64_t z, bool has_y, bool has_z, RunBits silent) {
    ErrorTargets targets;
    targets.silent_runs = silent;
    targets.row_stride = stride_;
    targets.is_end = is_end_;
    const std::int64_t upper_z = z >> cell_level_, upper_y = y >> cell_level_;
    for (std::int64_t k = upper_z - (isEnd(z) ? 1 : 0); k <= upper_z; ++k) {
      if (k < cells_.first.z || k >= cells_.end().z) continue;
      for (std::int64_t j = upper_y - (isEnd(y) ? 1 : 0); j <= upper_y; ++j) {
        if (j < cells_.first.y || j >= cells_.end().y) continue;
        const std::size_t i = rowOf(j, k);
        // Edges lead up, into the upper one of two rows.
        targets.rows[targets.count++] = {errorsOf(i), chunk_.touched_.data() + i,
                                         has_y && j == upper_y, has_z && k == upper_z};
      }
    }
    return targets;
  }
  float* errorsOf(std::size_t row) {
    return chunk_.greatest_.data() + row * static_cast<std::size_t>(stride_);
  }
  // Of the first bin.
  std::size_t rowOf(std::int64_t j, std::int64_t k) const {
    return static_cast<std::size_t>((k % 2 * cells_.count.y + j - cells_.first.y) * bins_.count);
  }

  // The errors of a layer of cells as codes; the layer's place is free again.
  void encode(std::int64_t k) {
    const auto share = static_cast<float>(1 / chunk_.bins_.unit());
    for (std::int64_t j = cells_.first.y; j < cells_.end().y; ++j)
      for (std::uint32_t bin = 0; bin < chunk_.bin_count_; ++bin) {
        const std::size_t i = rowOf(j, k) + bin;
        if (chunk_.touched_[i] == 0) continue;
        out_.use(chunk_.first_bin_ + bin);
        takeCodes(errorsOf(i), chunk_.touched_[i], voxels_.count.x, std::int64_t{1} << cell_level_,
                  chunk_.slack_, share,
                  out_.bin(chunk_.first_bin_ + bin) +
                      linearIndex(Index3(0, j - cells_.first.y, k - cells_.first.z), cells_.count));
        chunk_.touched_[i] = 0;
      }
  }

  ErrorChunk& chunk_;
  const bool is_of_voxels_;
  const int level_, cell_level_;
  const Bounds& bounds_;
  const IndexBox voxels_, samples_, cells_;
  const std::int64_t stride_, runs_;
  const IsovalueBins bins_;
  ErrorCodes& out_;
  std::int64_t plane_of_[2] = {-1, -1};
  float is_end_[kAlignment + kErrorRun];
  // Of voxels of a row that hang or do not along y and z, how often: whether they hang at all, and
  // are not at the centre of a cell.
  std::vector<float> is_between_[3];
};

void ErrorChunk::run(int level, Corners corners, int cell_level, ErrorCodes& out) {
  Run(*this, level, corners, cell_level, out)();
}

}  // namespace isobrick
