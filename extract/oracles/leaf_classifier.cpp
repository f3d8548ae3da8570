#include "isobrick/extract/oracles/leaf_classifier.h"

#include <algorithm>

#include "isobrick/extract/row_bits.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

CellState LeafClassifier::state(int level, const Index3& cell) {
  if (!contains({Index3(0), lattice_.cells(level)}, cell)) return CellState::kOutside;
  if (!refines(level + 1, cell / std::int64_t{2})) return CellState::kCoarser;
  return level > 0 && refines(level, cell) ? CellState::kFiner : CellState::kLeaf;
}

void LeafClassifier::classifyRow(int level, const Index3& first, std::int64_t count,
                                 std::uint64_t* exists, std::uint64_t* refined) {
  const Index3 first_parent = first / std::int64_t{2};
  const std::int64_t parents = (first.x + count - 1) / 2 - first_parent.x + 1;
  // Two rows, one after the other, have the same parents.
  if (parents_level_ != level + 1 || parents_first_ != first_parent || parents_count_ != parents) {
    parents_level_ = level + 1;
    parents_first_ = first_parent;
    parents_count_ = parents;
    parents_.resize(static_cast<std::size_t>(wordsOf(parents)));
    setBits(parents_.data(), parents);
    keepRefined(level + 1, first_parent, parents, parents_.data());
  }
  doubleBits(parents_.data(), parents, first.x % 2, count, exists);
  std::copy(exists, exists + wordsOf(count), refined);
  if (level > 0)
    keepRefined(level, first, count, refined);
  else
    std::fill(refined, refined + wordsOf(count), 0);
}

bool LeafClassifier::mayHoldLeaf(int level, const IndexBox& cells) const {
  return shareOfRefined(level + 1, parentsOf(cells)) != Share::kNone &&
         shareOfRefined(level, cells) != Share::kAll;
}

bool LeafClassifier::mayRefine(int level, const IndexBox& cells) const {
  return shareOfRefined(level, cells) != Share::kNone;
}

bool LeafClassifier::areAllLeaves(int level, const IndexBox& cells) const {
  const Index3 first = glm::max(cells.first - Index3(1), Index3(0));
  const Index3 end = glm::min(cells.end() + Index3(1), lattice_.cells(level));
  const IndexBox ring{first, end - first};
  return shareOfRefined(level + 1, parentsOf(ring)) == Share::kAll && !mayRefine(level, ring);
}

}  // namespace isobrick
