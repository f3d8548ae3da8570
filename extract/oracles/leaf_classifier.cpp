#include "isobrick/extract/oracles/leaf_classifier.h"

#include "isobrick/storage/index_loop.h"

namespace isobrick {

void LeafClassifier::classify(int level, const IndexBox& cells, std::vector<CellState>& out) {
  const Index3 first = glm::max(cells.first, Index3(0));
  const IndexBox inside{first, glm::min(cells.end(), lattice_.cells(level)) - first};
  // A parent decides for its eight cells, so it is asked once.
  const IndexBox parents = parentsOf(inside);
  parent_is_refined_.clear();
  forEachIndex(parents, [&](const Index3& parent) {
    parent_is_refined_.push_back(refines(level + 1, parent) ? 1 : 0);
  });
  const auto parentIsRefined = [&](const Index3& cell) {
    return parent_is_refined_[static_cast<std::size_t>(
               linearIndex(cell / std::int64_t{2} - parents.first, parents.count))] != 0;
  };
  out.clear();
  forEachIndex(cells, [&](const Index3& cell) {
    if (!contains(inside, cell))
      out.push_back(CellState::kOutside);
    else if (!parentIsRefined(cell))
      out.push_back(CellState::kCoarser);
    else
      out.push_back(level > 0 && refines(level, cell) ? CellState::kFiner : CellState::kLeaf);
  });
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
