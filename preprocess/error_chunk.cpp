#include "isobrick/preprocess/error_chunk.h"

#include <algorithm>
#include <cmath>

#include "isobrick/preprocess/kernels/error_rows.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

// Cells of `level` in a closed box of voxels whose ends are ends of such cells.
IndexBox cellsIn(const IndexBox& voxels, int level) {
  const std::int64_t step = std::int64_t{1} << level;
  const Index3 first = voxels.first / step;
  return {first, BrickLayout::ceilDivide(voxels.end() - Index3(1), step) - first};
}

void includeCodes(const ErrorCodes& other, ErrorCodes& codes) {
  for (std::size_t i = 0; i < codes.codes.size(); ++i)
    codes.codes[i] = std::max(codes.codes[i], other.codes[i]);
}

// The cells that touch cell c, itself or its children among them, along one axis: those from
// scale * c + first to scale * c + last.
struct Touching {
  std::int64_t scale, first, last;
};
constexpr Touching kNeighbours = {1, -1, 1};
constexpr Touching kFiner = {2, -1, 2};

// The greatest codes of the cells that touch a row's cells along it: `count` cells from `first` on.
// `from` are the codes of cells from `from_first` on.
void greatestAlongRow(const Touching& touching, const std::uint8_t* from, std::int64_t from_first,
                      std::int64_t from_count, std::int64_t first, std::int64_t count,
                      std::vector<std::uint8_t>& scratch, std::uint8_t* to) {
  constexpr std::int64_t kPadding = 8;
  const std::int64_t size = from_count + 2 * kPadding;
  scratch.assign(static_cast<std::size_t>(2 * size), 0);
  std::uint8_t* const padded = scratch.data();
  std::uint8_t* const greatest = padded + size;  // of the run of cells that begins there
  std::copy_n(from, from_count, padded + kPadding);
  const std::int64_t length = touching.last - touching.first + 1;
  std::copy_n(padded, size, greatest);
  for (std::int64_t i = 1; i < length; ++i)
    for (std::int64_t x = 0; x < size - i; ++x) greatest[x] = std::max(greatest[x], padded[x + i]);
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
  const std::int64_t low = from.cells.first[axis], high = from.cells.end()[axis] - 1;
  std::vector<std::uint8_t> scratch;
  for (std::uint32_t bin = from.first_bin; bin < from.first_bin + from.bins; ++bin) {
    const std::uint8_t* const source = from.bin(bin);
    std::uint8_t* target = to.bin(bin);
    for (std::int64_t z = 0; z < box.count.z; ++z)
      for (std::int64_t y = 0; y < box.count.y; ++y, target += box.count.x) {
        Index3 at(0, y, z);
        if (axis == 0) {
          greatestAlongRow(touching, source + linearIndex(at, from.cells.count), low,
                           from.cells.count.x, first, count, scratch, target);
          continue;
        }
        const std::int64_t cell = touching.scale * (first + at[axis]);
        for (std::int64_t i = std::max(cell + touching.first, low);
             i <= std::min(cell + touching.last, high); ++i) {
          at[axis] = i - low;
          const std::uint8_t* const row = source + linearIndex(at, from.cells.count);
          for (std::int64_t x = 0; x < box.count.x; ++x) target[x] = std::max(target[x], row[x]);
        }
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
}

IndexBox ErrorChunk::voxelsAround(const Lattice& lattice, const Index3& chunk,
                                  std::int64_t margin) {
  const Index3 first = glm::max(chunk * kVoxels - Index3(margin), Index3(0));
  const Index3 last =
      glm::min((chunk + Index3(1)) * kVoxels + Index3(margin), lattice.voxels() - Index3(1));
  return {first, last - first + Index3(1)};
}

IndexBox ErrorChunk::cells(const Lattice& lattice, int level, const Index3& chunk) {
  return cellsIn(voxelsAround(lattice, chunk, 0), level);
}

IndexBox ErrorChunk::samples(const Lattice& lattice, int level, const Index3& chunk) {
  const IndexBox cells = cellsIn(voxelsAround(lattice, chunk, kMargin), level);
  return {cells.first, cells.count + Index3(1)};
}

void ErrorChunk::find(const Lattice& lattice, const ErrorBins& bins, const ValueRange& values,
                      const Index3& chunk, const Read& read) {
  lattice_ = &lattice;
  bins_ = bins;
  chunk_ = chunk;
  // What single precision may change: everything is made of a few operations on such values.
  slack_ = 0x1p-18f * std::max(std::abs(values.min), std::abs(values.max));
  ValueRange range;
  for (int level = 0; level <= bins.last_level; ++level) {
    Field& field = samples_[level];
    field.box = samples(lattice, level, chunk);
    field.values.assign(static_cast<std::size_t>(field.box.size() + kErrorRowPadding), 0.0f);
    read(level, field.box, field.values.data());
    const auto [least, greatest] =
        std::minmax_element(field.values.begin(), field.values.begin() + field.box.size());
    range.include({*least, *greatest});
  }
  // Bounds are a slack wider than samples, and bins are looked up a slack around them.
  first_bin_ = bins.binOf(static_cast<double>(range.min - 3 * slack_));
  bin_count_ = bins.binOf(static_cast<double>(range.max + 3 * slack_)) - first_bin_ + 1;
  const auto cellsAround = [&](int level, std::int64_t margin) {
    return cellsIn(voxelBox(margin), level);
  };
  least_.clear();
  most_.clear();
  for (std::uint32_t bin = first_bin_; bin < first_bin_ + bin_count_; ++bin) {
    const auto room = 2 * slack_ + 0x1p-6f * static_cast<float>(bins.width);
    least_.push_back(static_cast<float>(bins.least(bin)) - room);
    most_.push_back(static_cast<float>(bins.greatest(bin)) + room);
  }
  room_ = 0x1p-8f + 4 * slack_ / static_cast<float>(bins.width);
  first_isovalue_ = static_cast<float>(bins.first + first_bin_ * bins.width);
  const std::int64_t margin = bins.last_level == 2 ? 0 : 4;
  if (range.min == range.max) {
    for (int level = kFirstErrorLevel; level <= bins.last_level; ++level)
      found_[level - kFirstErrorLevel].reset(cellsAround(level, level == 2 ? margin : 0),
                                             first_bin_, 0);
    return;
  }
  for (int level = 1; level <= bins.last_level; ++level) boundOwn(level);
  // Level 1: its own cells, and those of level 0 that touch them.
  boundHanging(0);
  run(0, Corners::kHanging, 1, kMargin, fine_[0]);
  greatestTouching(cellsAround(1, kMargin), kNeighbours, fine_[0], touching_, fine_[1]);
  boundHanging(1);
  run(1, Corners::kHanging, 1, kMargin, fine_[0]);
  includeCodes(fine_[0], fine_[1]);

  ErrorCodes& level2 = found_[0];
  greatestTouching(cellsAround(2, margin), kFiner, fine_[1], touching_, level2);
  run(2, Corners::kOwn, 2, margin, fine_[0]);
  includeCodes(fine_[0], level2);
  if (bins.last_level == 2) return;

  boundHanging(2);
  run(2, Corners::kHanging, 2, margin, hanging_codes_);
  includeCodes(level2, hanging_codes_);
  ErrorCodes& level3 = found_[1];
  greatestTouching(cellsAround(3, 0), kFiner, hanging_codes_, touching_, level3);
  run(3, Corners::kOwn, 3, 0, fine_[0]);
  includeCodes(fine_[0], level3);
}

// At each sample of the level the lesser and the greater of it and of that of the next finer one.
void ErrorChunk::boundOwn(int level) {
  const Field& coarse = samples_[level];
  const Field& fine = samples_[level - 1];
  Bounds& bounds = own_[level];
  bounds.low.box = bounds.high.box = coarse.box;
  bounds.low.values.clear();
  bounds.high.values.clear();
  const Index3 last_fine = lattice_->samples(level - 1) - Index3(1);
  std::size_t i = 0;
  forEachIndex(coarse.box, [&](const Index3& at) {
    const float a = coarse.values[i++];
    const float b = fine.at(glm::min(std::int64_t{2} * at, last_fine));
    bounds.low.values.push_back(std::min(a, b));
    bounds.high.values.push_back(std::max(a, b));
  });
}

// The same, and what a sample may get that hangs on an edge or a face of the next coarser level.
void ErrorChunk::boundHanging(int level) {
  const Field& own_low = level == 0 ? samples_[0] : own_[level].low;
  const Field& own_high = level == 0 ? samples_[0] : own_[level].high;
  const Bounds& coarse = own_[level + 1];
  const IndexBox& box = hanging_.low.box = hanging_.high.box = own_low.box;
  const auto size = static_cast<std::size_t>(box.size());
  hanging_.low.values.assign(size + kErrorRowPadding, 0.0f);
  hanging_.high.values.assign(size + kErrorRowPadding, 0.0f);
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
  Run(ErrorChunk& chunk, int level, Corners corners, int cell_level, std::int64_t margin,
      ErrorCodes& out)
      : chunk_(chunk),
        level_(level),
        cell_level_(cell_level),
        bounds_(corners == Corners::kOwn ? chunk.own_[level] : chunk.hanging_),
        voxels_(chunk.voxelBox(margin)),
        cells_(cellsIn(voxels_, cell_level)),
        stride_(voxels_.count.x + kErrorRowPadding),
        out_(out) {
    out.reset(cells_, chunk.first_bin_, chunk.bin_count_);
    const auto plane = static_cast<std::size_t>(voxels_.count.y * stride_);
    for (Plane& p : chunk.planes_) {
      p.low.resize(plane);
      p.high.resize(plane);
    }
    chunk.lattice_row_.resize(static_cast<std::size_t>(stride_));
    const auto rows = static_cast<std::size_t>(2 * cells_.count.y * chunk.bin_count_);
    chunk.greatest_.assign(rows * static_cast<std::size_t>(stride_) + 2 * kErrorRowPadding, 0.0f);
    chunk.is_touched_.assign(rows, 0);
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
  bool isEnd(std::int64_t voxel) const {
    return (voxel & ((std::int64_t{1} << cell_level_) - 1)) == 0;
  }

  // The bounds of a plane of voxels, from those at the samples of the level.
  void fill(std::int64_t z) {
    Plane& plane = chunk_.planes_[z % 2];
    for (std::int64_t y = voxels_.first.y; y < voxels_.end().y; ++y) {
      const std::int64_t row = y - voxels_.first.y;
      float* const low = plane.low.data() + row * stride_;
      float* const high = plane.high.data() + row * stride_;
      fillRow(bounds_.low, y, z, low);
      fillRow(bounds_.high, y, z, high);
      for (std::int64_t x = 0; x < voxels_.count.x; ++x) {
        low[x] -= chunk_.slack_;
        high[x] += chunk_.slack_;
      }
      std::fill_n(low + voxels_.count.x, kErrorRowPadding, low[voxels_.count.x - 1]);
      std::fill_n(high + voxels_.count.x, kErrorRowPadding, high[voxels_.count.x - 1]);
    }
  }

  void fillRow(const Field& field, std::int64_t y, std::int64_t z, float* out) {
    const std::int64_t first = voxels_.first.x >> level_;
    const std::int64_t samples = cellsIn(voxels_, level_).count.x + 1;
    float* const row = chunk_.lattice_row_.data();
    std::fill_n(row, samples, 0.0f);
    const Share ys = shareOf(1, y), zs = shareOf(2, z);
    for (int k = 0; k < 2; ++k)
      for (int j = 0; j < 2; ++j) {
        const float weight =
            (j == 1 ? ys.of_upper : 1 - ys.of_upper) * (k == 1 ? zs.of_upper : 1 - zs.of_upper);
        if (weight <= 0) continue;
        const float* const from =
            field.values.data() +
            linearIndex(Index3(first, ys.sample + j, zs.sample + k) - field.box.first,
                        field.box.count);
        for (std::int64_t i = 0; i < samples; ++i) row[i] += weight * from[i];
      }
    spread(level_, row, voxels_.count.x, out);
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

  const float* valueRow(std::int64_t y, std::int64_t z) const {
    const Field& values = chunk_.samples_[0];
    return values.values.data() +
           linearIndex(Index3(voxels_.first.x, y, z) - values.box.first, values.box.count);
  }
  BracketedRow row(std::int64_t y, std::int64_t z) const {
    const Plane& plane = chunk_.planes_[z % 2];
    const std::int64_t offset = (y - voxels_.first.y) * stride_;
    return {valueRow(y, z), plane.low.data() + offset, plane.high.data() + offset};
  }
  void findIn(std::int64_t y, std::int64_t z) {
    const bool has_y = y + 1 < voxels_.end().y, has_z = z + 1 < voxels_.end().z;
    ErrorTargets targets;
    targets.row_stride = stride_;
    targets.here_count = addCellRows(y, z, true, true, targets.here);
    if (has_y) targets.along_y_count = addCellRows(y, z, false, true, targets.along_y);
    if (has_z) targets.along_z_count = addCellRows(y, z, true, false, targets.along_z);
    includeErrorsOfRow(row(y, z), has_y ? row(y + 1, z) : BracketedRow{},
                       has_z ? row(y, z + 1) : BracketedRow{}, voxels_.count.x,
                       {chunk_.least_.data(), chunk_.most_.data(), chunk_.first_isovalue_,
                        static_cast<float>(chunk_.bins_.width), chunk_.room_,
                        static_cast<std::int64_t>(chunk_.bin_count_)},
                       targets);
  }

  // The rows of cells that hold a row of voxels, or, where not closed along an axis, the edges that
  // lead up from it there. How many.
  int addCellRows(std::int64_t y, std::int64_t z, bool is_closed_y, bool is_closed_z,
                  GreatestErrors* rows) {
    const auto below = [&](std::int64_t voxel, bool is_closed) {
      return (voxel >> cell_level_) - (is_closed && isEnd(voxel) ? 1 : 0);
    };
    int count = 0;
    for (std::int64_t k = below(z, is_closed_z); k <= z >> cell_level_; ++k) {
      if (k < cells_.first.z || k >= cells_.end().z) continue;
      for (std::int64_t j = below(y, is_closed_y); j <= y >> cell_level_; ++j) {
        if (j < cells_.first.y || j >= cells_.end().y) continue;
        const std::size_t i = rowOf(j, k, chunk_.first_bin_);
        rows[count++] = {errorsOf(i), chunk_.is_touched_.data() + i};
      }
    }
    return count;
  }
  float* errorsOf(std::size_t row) {
    return chunk_.greatest_.data() + kErrorRowPadding + row * static_cast<std::size_t>(stride_);
  }
  std::size_t rowOf(std::int64_t j, std::int64_t k, std::uint32_t bin) const {
    return (static_cast<std::size_t>(k % 2 * cells_.count.y + j - cells_.first.y)) *
               chunk_.bin_count_ +
           (bin - chunk_.first_bin_);
  }

  // The errors of a layer of cells as codes; the layer's place is free again.
  void encode(std::int64_t k) {
    const float share = static_cast<float>(1 / chunk_.bins_.unit());
    const std::int64_t step = std::int64_t{1} << cell_level_;
    for (std::int64_t j = cells_.first.y; j < cells_.end().y; ++j)
      for (std::uint32_t bin = chunk_.first_bin_; bin < chunk_.first_bin_ + chunk_.bin_count_;
           ++bin) {
        const std::size_t i = rowOf(j, k, bin);
        if (chunk_.is_touched_[i] == 0) continue;
        chunk_.is_touched_[i] = 0;
        float* const errors = errorsOf(i);
        std::uint8_t* const codes =
            out_.bin(bin) + linearIndex(Index3(cells_.first.x, j, k) - cells_.first, cells_.count);
        for (std::int64_t x = 0; x < cells_.count.x; ++x) {
          const std::int64_t end = std::min((x + 1) * step, voxels_.count.x - 1);
          const float greatest = *std::max_element(errors + x * step, errors + end);
          codes[x] = greatest > 0 ? ErrorCode::encodeUp((greatest + chunk_.slack_) * share)
                                  : std::uint8_t{0};
        }
        std::fill_n(errors - 1, voxels_.count.x + 1, 0.0f);
      }
  }

  ErrorChunk& chunk_;
  const int level_, cell_level_;
  const Bounds& bounds_;
  const IndexBox voxels_, cells_;
  const std::int64_t stride_;
  ErrorCodes& out_;
};

void ErrorChunk::run(int level, Corners corners, int cell_level, std::int64_t margin,
                     ErrorCodes& out) {
  Run(*this, level, corners, cell_level, margin, out)();
}

}  // namespace isobrick
