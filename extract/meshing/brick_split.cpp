#include "isobrick/extract/meshing/brick_split.h"

#include <algorithm>

#include "isobrick/extract/kernels/row_bits.h"

namespace isobrick {

void BrickSplit::split(const MeshContext& context, LeafClassifier& classifier,
                       const CrossedTiles& tiles, int level, const IndexBox& cells,
                       BrickRows& rows) {
  level_ = level;
  cells_ = cells;
  words_ = wordsOf(cells.count.x);
  has_plain_ = false;
  zone_rows_.clear();
  crossed_cells_.resize(static_cast<std::size_t>(words_));
  leaves_.reset(classifier, context.lattice(), level, cells);
  zone_.clear();
  const std::int64_t edge = context.pyramid.layout().tileCells();
  for (std::int64_t z = 0; z < tiles.dims().z; ++z) {
    const Index3 first(0, 0, z * edge);
    const Index3 end(cells.count.x, cells.count.y, std::min((z + 1) * edge, cells.count.z));
    if (!classifier.mayHoldLeaf(level, {cells.first + first, end - first})) continue;
    for (std::int64_t y = 0; y < tiles.dims().y; ++y)
      splitTileRow(context, classifier, tiles, y, z, rows);
  }
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
    if (!tiles.isCrossed({x, y, z})) continue;
    const std::int64_t end = std::min((x + 1) * edge, cells_.count.x);
    for (std::int64_t word = x * edge / 64; 64 * word < end; ++word)
      crossed_cells_[static_cast<std::size_t>(word)] |= bitsBetween(x * edge, end, word);
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
  if (zone_.empty())
    zone_.resize(static_cast<std::size_t>((cells_.count.y + 2) * (cells_.count.z + 2) * words_));
  std::uint64_t* rest = zone_.data() + index(j, k) * words_;
  leaves_.find(j, k);
  leaves_.leaves(j, k, rest);
  for (std::int64_t word = 0; word < words_; ++word)
    rest[word] &= crossed_cells_[static_cast<std::size_t>(word)];
  if (context.query.box) keepOverlapping(context, j, k, rest);
  std::uint64_t any = 0;
  for (std::int64_t word = 0; word < words_; ++word) any |= rest[word];
  if (any == 0) return;
  leaves_.findAround(j, k);
  std::uint64_t* wanted = rows.wantedCells(j, k);
  leaves_.leavesAmongLeaves(j, k, wanted);
  any = 0;
  for (std::int64_t word = 0; word < words_; ++word) {
    const std::uint64_t plain = rest[word] & wanted[word];
    has_plain_ = has_plain_ || plain != 0;
    wanted[word] = rest[word];
    rest[word] &= ~plain;
    any |= rest[word];
  }
  if (any == 0) return;
  zone_rows_.push_back({j, k});
}

// Keeps the cells in a row that the query's box overlaps.
void BrickSplit::keepOverlapping(const MeshContext& context, std::int64_t j, std::int64_t k,
                                 std::uint64_t* bits) const {
  keepBitsWhere(bits, words_, [&](std::int64_t i) {
    return overlapsQueryBox(context, level_, {cells_.first + Index3(i, j, k), Index3(1)});
  });
}

}  // namespace isobrick
