#include "isobrick/extract/meshing/brick_split.h"

#include <algorithm>

#include "isobrick/extract/kernels/row_bits.h"

namespace isobrick {

void BrickSplit::split(const MeshContext& context, LeafClassifier& classifier,
                       const CrossedTiles& tiles, int level, const IndexBox& cells,
                       BrickRows& rows) {
  clearZone();
  level_ = level;
  cells_ = cells;
  words_ = wordsOf(cells.count.x);
  has_plain_ = false;
  crossed_cells_.resize(static_cast<std::size_t>(words_));
  row_leaves_.resize(static_cast<std::size_t>(words_));
  others_.resize(static_cast<std::size_t>(words_));
  leaves_.reset(classifier, context.lattice(), level, cells);
  zone_.resize(static_cast<std::size_t>((cells.count.y + 2) * (cells.count.z + 2) * words_));
  const std::int64_t edge = context.pyramid.layout().tileCells();
  for (std::int64_t z = 0; z < tiles.dims().z; ++z) {
    const Index3 first(0, 0, z * edge);
    const Index3 end(cells.count.x, cells.count.y, std::min((z + 1) * edge, cells.count.z));
    if (!classifier.mayHoldLeaf(level, {cells.first + first, end - first})) continue;
    for (std::int64_t y = 0; y < tiles.dims().y; ++y)
      splitTileRow(context, classifier, tiles, y, z, rows);
  }
}

// Of the brick before: all other words are zeros anyway.
void BrickSplit::clearZone() {
  for (const auto& [j, k] : zone_rows_) {
    std::uint64_t* const row = zoneAt(j, k);
    std::fill(row, row + words_, 0);
  }
  zone_rows_.clear();
}

void BrickSplit::splitTileRow(const MeshContext& context, const LeafClassifier& classifier,
                              const CrossedTiles& tiles, std::int64_t y, std::int64_t z,
                              BrickRows& rows) {
  const std::int64_t edge = context.pyramid.layout().tileCells();
  const CrossedTiles::Span span = tiles.crossedSpan(y, z);
  if (span.begin == span.end) return;
  const IndexBox crossed = CrossedTiles::cellsOf(span, y, z, cells_, edge);
  if (!overlapsQueryBox(context, level_, crossed) || !classifier.mayHoldLeaf(level_, crossed))
    return;
  std::fill(crossed_cells_.begin(), crossed_cells_.end(), 0);
  for (std::int64_t x = span.begin; x < span.end; ++x) {
    const std::int64_t begin = x;
    while (x < span.end && tiles.isCrossed({x, y, z})) ++x;
    const std::int64_t end = std::min(x * edge, cells_.count.x);
    for (std::int64_t word = begin * edge / 64; 64 * word < end; ++word)
      crossed_cells_[static_cast<std::size_t>(word)] |= bitsBetween(begin * edge, end, word);
  }
  const bool are_plain = !context.query.box && classifier.areAllLeaves(level_, crossed);
  has_plain_ = has_plain_ || are_plain;
  const Index3 first = crossed.first - cells_.first, end = first + crossed.count;
  for (std::int64_t k = first.z; k < end.z; ++k)
    for (std::int64_t j = first.y; j < end.y; ++j) {
      if (are_plain)
        std::copy(crossed_cells_.begin(), crossed_cells_.end(), rows.wantedCells(j, k));
      else
        splitRow(context, j, k, rows);
    }
}

// The cells of crossed tiles in one row.
void BrickSplit::splitRow(const MeshContext& context, std::int64_t j, std::int64_t k,
                          BrickRows& rows) {
  leaves_.find(j, k);
  leaves_.leaves(j, k, row_leaves_.data());
  const auto words = static_cast<std::size_t>(words_);
  for (std::size_t word = 0; word < words; ++word) row_leaves_[word] &= crossed_cells_[word];
  if (context.query.box) keepOverlapping(context, j, k, row_leaves_.data());
  std::uint64_t any = 0;
  for (std::size_t word = 0; word < words; ++word) any |= row_leaves_[word];
  if (any == 0) return;
  leaves_.findAround(j, k);
  leaves_.besideOthers(j, k, others_.data());
  zone_rows_.push_back({j, k});  // nothing throws between this and the row's words
  std::uint64_t *const wanted = rows.wantedCells(j, k), *const zone = zoneAt(j, k);
  any = 0;
  for (std::size_t word = 0; word < words; ++word) {
    wanted[word] = row_leaves_[word];
    zone[word] = row_leaves_[word] & others_[word];
    has_plain_ = has_plain_ || zone[word] != wanted[word];
    any |= zone[word];
  }
  if (any == 0) zone_rows_.pop_back();
}

// Keeps the cells in a row that the query's box overlaps.
void BrickSplit::keepOverlapping(const MeshContext& context, std::int64_t j, std::int64_t k,
                                 std::uint64_t* bits) const {
  keepBitsWhere(bits, words_, [&](std::int64_t i) {
    return overlapsQueryBox(context, level_, {cells_.first + Index3(i, j, k), Index3(1)});
  });
}

}  // namespace isobrick
