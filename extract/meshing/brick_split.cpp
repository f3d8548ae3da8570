#include "isobrick/extract/meshing/brick_split.h"

#include <algorithm>

#include "isobrick/extract/row_bits.h"

namespace isobrick {

void BrickSplit::split(const MeshContext& context, LeafClassifier& classifier,
                       const ActiveTiles& tiles, int level, const IndexBox& cells,
                       BrickRows& rows) {
  level_ = level;
  cells_ = cells;
  words_ = wordsOf(cells.count.x);
  has_plain_ = false;
  seam_rows_.clear();
  fans_.clear();
  leaves_.reset(classifier, context.lattice(), level, cells);
  seam_.assign(static_cast<std::size_t>((cells.count.y + 2) * (cells.count.z + 2) * words_), 0);
  for (std::int64_t z = 0; z < tiles.dims().z; ++z)
    for (std::int64_t y = 0; y < tiles.dims().y; ++y)
      if (tiles.isAnyActive(y, z)) splitTileRow(context, classifier, tiles, y, z, rows);
}

void BrickSplit::splitTileRow(const MeshContext& context, const LeafClassifier& classifier,
                              const ActiveTiles& tiles, std::int64_t y, std::int64_t z,
                              BrickRows& rows) {
  const std::int64_t edge = context.pyramid.layout().tileCells();
  const Index3 first(0, y * edge, z * edge);
  const Index3 count = glm::min(Index3(cells_.count.x, edge, edge), cells_.count - first);
  const IndexBox row{cells_.first + first, count};
  if (!classifier.mayHoldLeaf(level_, row) || !overlapsQueryBox(context, level_, row)) return;
  const auto areAllPlain = [&](const IndexBox& box) {
    return !context.query.box && classifier.areAllLeaves(level_, box);
  };
  const bool row_is_plain = areAllPlain(row);
  plain_cells_.assign(static_cast<std::size_t>(words_), 0);
  mixed_cells_.assign(static_cast<std::size_t>(words_), 0);
  bool any_plain = false, any_mixed = false;
  for (std::int64_t x = 0; x < tiles.dims().x; ++x) {
    if (!tiles.isActive({x, y, z})) continue;
    const std::int64_t begin = x * edge, end = std::min(begin + edge, cells_.count.x);
    const IndexBox tile{row.first + Index3(begin, 0, 0), Index3(end - begin, count.y, count.z)};
    if (!row_is_plain && !classifier.mayHoldLeaf(level_, tile)) continue;
    const bool is_plain = row_is_plain || areAllPlain(tile);
    (is_plain ? any_plain : any_mixed) = true;
    auto& cells = is_plain ? plain_cells_ : mixed_cells_;
    for (std::int64_t word = begin / 64; 64 * word < end; ++word)
      cells[static_cast<std::size_t>(word)] |= bitsBetween(begin, end, word);
  }
  has_plain_ = has_plain_ || any_plain;
  for (std::int64_t k = first.z; k < first.z + count.z; ++k)
    for (std::int64_t j = first.y; j < first.y + count.y; ++j) {
      if (any_mixed) splitRow(context, j, k, rows);
      if (any_plain)
        for (std::int64_t word = 0; word < words_; ++word)
          rows.wantedCells(j, k)[word] |= plain_cells_[static_cast<std::size_t>(word)];
    }
}

// The cells of mixed tiles in one row.
void BrickSplit::splitRow(const MeshContext& context, std::int64_t j, std::int64_t k,
                          BrickRows& rows) {
  for (std::int64_t dk = -1; dk <= 1; ++dk)
    for (std::int64_t dj = -1; dj <= 1; ++dj) leaves_.find(j + dj, k + dk);
  std::uint64_t* wanted = rows.wantedCells(j, k);
  std::uint64_t* rest = seam_.data() + index(j, k) * words_;
  leaves_.leaves(j, k, rest);
  leaves_.leavesAmongLeaves(j, k, wanted);
  if (context.query.box) {
    keepOverlapping(context, j, k, rest);
    keepOverlapping(context, j, k, wanted);
  }
  bool any = false;
  for (std::int64_t word = 0; word < words_; ++word) {
    wanted[word] &= mixed_cells_[static_cast<std::size_t>(word)];
    rest[word] &= ~wanted[word] & mixed_cells_[static_cast<std::size_t>(word)];
    any = any || rest[word] != 0;
    has_plain_ = has_plain_ || wanted[word] != 0;
    wanted[word] |= rest[word];
  }
  if (!any) return;
  seam_rows_.push_back({j, k});
  fans_.resize(fans_.size() + static_cast<std::size_t>(words_));
  std::uint64_t* fans = fans_.data() + fans_.size() - words_;
  leaves_.besideFiner(j, k, fans);
  for (std::int64_t word = 0; word < words_; ++word) fans[word] &= rest[word];
}

// Of cells in a row keeps those that the query's box overlaps.
void BrickSplit::keepOverlapping(const MeshContext& context, std::int64_t j, std::int64_t k,
                                 std::uint64_t* bits) const {
  keepBitsWhere(bits, words_, [&](std::int64_t i) {
    return overlapsQueryBox(context, level_, {cells_.first + Index3(i, j, k), Index3(1)});
  });
}

}  // namespace isobrick
