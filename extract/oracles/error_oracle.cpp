#include "isobrick/extract/oracles/error_oracle.h"

#include <algorithm>
#include <cmath>

#include "isobrick/extract/oracles/error_cells.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

// What single precision may add to an error: each is made of a few operations on values of this
// size.
float roundingOf(const ValueRange& values, float isovalue) {
  return 0x1p-20f * std::max({std::abs(values.min), std::abs(values.max), std::abs(isovalue)});
}

// Bits [from, from + count) of a row go to bits [to, to + count) of another; set ones are added.
void addBits(const std::uint64_t* source, std::int64_t from, std::uint64_t* target, std::int64_t to,
             std::int64_t count) {
  for (std::int64_t done = 0; done < count;) {
    const std::int64_t source_bit = (from + done) % 64, target_bit = (to + done) % 64;
    const std::int64_t some = std::min({count - done, 64 - source_bit, 64 - target_bit});
    const std::uint64_t bits = source[(from + done) / 64] >> source_bit & lowBits(some);
    target[(to + done) / 64] |= bits << target_bit;
    done += some;
  }
}

void addBits(const CellBits& source, CellBits& target) {
  const Index3 first = glm::max(source.box().first, target.box().first);
  const Index3 end = glm::min(source.box().end(), target.box().end());
  if (first.x >= end.x) return;
  for (std::int64_t z = first.z; z < end.z; ++z)
    for (std::int64_t y = first.y; y < end.y; ++y)
      addBits(source.row(y, z), first.x - source.box().first.x, target.row(y, z),
              first.x - target.box().first.x, end.x - first.x);
}

}  // namespace

ErrorOracle::ErrorOracle(double tolerance, float isovalue, const ValueRange& values)
    : tolerance_(static_cast<float>(tolerance) - roundingOf(values, isovalue)),
      isovalue_(isovalue) {}
ErrorOracle::~ErrorOracle() = default;

template <typename Make>
ErrorOracle::Bits ErrorOracle::Shelf::get(std::size_t row, const Make& make) {
  {
    const std::lock_guard lock(mutex_);
    if (const auto known = bits_.find(row); known != bits_.end()) return known->second;
  }
  // Two threads may make the same; it is the same.
  auto made = std::make_shared<const CellBits>(make());
  const std::lock_guard lock(mutex_);
  const auto [entry, is_new] = bits_.try_emplace(row, std::move(made));
  const Bits bits = entry->second;
  if (is_new) {
    order_.push_back(row);
    if (order_.size() > kMostBricks) {
      bits_.erase(order_.front());
      order_.pop_front();
    }
  }
  return bits;
}

ErrorOracle::Bits ErrorOracle::foundIn(const MeshContext& context, const Index3& brick) const {
  return found_.get(context.pyramid.brickRow(0, brick), [&] {
    thread_local ErrorCells cells;
    return cells.find(context, brick, {isovalue_, tolerance_});
  });
}

ErrorOracle::Bits ErrorOracle::decided(const MeshContext& context, const Index3& brick) const {
  const BrickLayout& layout = context.pyramid.layout();
  return decided_.get(context.pyramid.brickRow(0, brick), [&] {
    CellBits cells(coarseCellsOf(layout, brick));
    const Index3 first = glm::max(brick - Index3(1), Index3(0));
    const Index3 end = glm::min(brick + Index3(2), layout.bricks(0));
    forEachIndex({first, end - first},
                 [&](const Index3& other) { addBits(*foundIn(context, other), cells); });
    return cells;
  });
}

bool ErrorOracle::refines(const MeshContext& context, int level, const Index3& cell) const {
  if (level != 1 || context.lattice().levels() == 1) return true;
  const Index3 brick = std::int64_t{2} * cell / context.pyramid.layout().brickCells();
  return decided(context, brick)->has(cell);
}

void ErrorOracle::keepRefined(const MeshContext& context, int level, const Index3& first,
                              std::int64_t count, std::uint64_t* bits) const {
  if (level != 1 || context.lattice().levels() == 1) return;
  const std::int64_t brick_cells = context.pyramid.layout().brickCells();
  for (std::int64_t begin = 0; begin < count;) {
    const Index3 cell = first + Index3(begin, 0, 0);
    const Index3 brick = std::int64_t{2} * cell / brick_cells;
    const std::int64_t end = std::min(count, (brick.x + 1) * brick_cells / 2 - first.x);
    if (!hasBitsBetween(bits, begin, end)) {
      begin = end;
      continue;
    }
    const Bits decided_here = decided(context, brick);
    for (std::int64_t word = begin / 64; 64 * word < end; ++word) {
      const std::int64_t from = std::max(begin, 64 * word), to = std::min(end, 64 * (word + 1));
      std::uint64_t kept = 0;
      addBits(decided_here->row(first.y, first.z), first.x + from - decided_here->box().first.x,
              &kept, from % 64, to - from);
      bits[word] &= kept | ~bitsBetween(from, to, word);
    }
    begin = end;
  }
}

}  // namespace isobrick
