#include "isobrick/extract/oracles/leaf_classifier.h"

#include <algorithm>

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/extract/oracles/residency_oracle.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

bool LeafClassifier::Choice::refines(int level, const Index3& cell) {
  return shared.focus.refines(level, cell) && (!shared.view || shared.view->refines(level, cell)) &&
         curvature.refines(level, cell);
}

void LeafClassifier::Choice::keepRefined(int level, const Index3& first, std::int64_t count,
                                         std::uint64_t* bits) {
  keepPlaced(level, first, count, bits);
  curvature.keepRefined(level, first, count, bits);
}

void LeafClassifier::Choice::keepPlaced(int level, const Index3& first, std::int64_t count,
                                        std::uint64_t* bits) const {
  shared.focus.keepRefined(level, first, count, bits);
  if (shared.view) shared.view->keepRefined(level, first, count, bits);
}

Coverage LeafClassifier::Choice::refinedCoverage(int level, const IndexBox& box) const {
  Coverage coverage = shared.focus.refinedCoverage(level, box);
  if (coverage != Coverage::kNone && shared.view)
    coverage = coarserCoverage(coverage, shared.view->refinedCoverage(level, box));
  if (coverage != Coverage::kNone)
    coverage = coarserCoverage(coverage, curvature.refinedCoverage(level, box));
  return coverage;
}

LeafClassifier::LeafClassifier(const MeshContext& context, BrickReads reads)
    : lattice_(context.lattice()), residency_(context.residency) {
  choices_.reserve(context.oracles.size());
  for (const ChoiceOracles& shared : context.oracles)
    choices_.push_back(
        {shared, CurvatureOracle(context, *shared.choice, shared.flat.get(), reads)});
  has_runs_ = residency_ == nullptr && choices_.size() == 1 && !choices_[0].shared.view &&
              !choices_[0].shared.choice->curvature_tolerance;
}

bool LeafClassifier::refines(int level, const Index3& cell) {
  if (residency_ != nullptr) {
    std::uint64_t bit = 1;
    keepResident(level, cell, 1, &bit);
    if (bit == 0) return false;
  }
  return std::any_of(choices_.begin(), choices_.end(),
                     [&](Choice& choice) { return choice.refines(level, cell); });
}

void LeafClassifier::keepRefined(int level, const Index3& first, std::int64_t count,
                                 std::uint64_t* bits) {
  if (residency_ != nullptr) keepResident(level, first, count, bits);
  if (choices_.size() == 1) {
    choices_[0].keepRefined(level, first, count, bits);
    return;
  }
  const auto words = static_cast<std::size_t>(wordsOf(count));
  asked_.assign(bits, bits + words);
  std::fill(bits, bits + words, 0);
  for (Choice& choice : choices_) {
    kept_ = asked_;
    choice.keepRefined(level, first, count, kept_.data());
    for (std::size_t word = 0; word < words; ++word) {
      bits[word] |= kept_[word];
      asked_[word] &= ~kept_[word];  // the other choices need not test these
    }
  }
}

// Before the choices, as some of their oracles read bricks. Notes only cells that these refine.
void LeafClassifier::keepResident(int level, const Index3& first, std::int64_t count,
                                  std::uint64_t* bits) {
  const auto words = static_cast<std::size_t>(wordsOf(count));
  asked_.assign(words, 0);
  for (const Choice& choice : choices_) {
    kept_.assign(bits, bits + words);
    choice.keepPlaced(level, first, count, kept_.data());
    for (std::size_t word = 0; word < words; ++word) asked_[word] |= kept_[word];
  }
  std::copy(asked_.begin(), asked_.end(), bits);
  residency_->keepRefined(level, first, count, bits);
  for (std::size_t word = 0; word < words; ++word) asked_[word] &= ~bits[word];
  keepBitsWhere(asked_.data(), wordsOf(count), [&](std::int64_t i) {
    residency_->noteRefused(level, {first + Index3(i, 0, 0), Index3(1)});
    return false;
  });
}

Coverage LeafClassifier::refinedCoverage(int level, const IndexBox& cells) const {
  Coverage coverage = Coverage::kNone;
  for (const Choice& choice : choices_) {
    coverage = finerCoverage(coverage, choice.refinedCoverage(level, cells));
    if (coverage == Coverage::kAll) break;
  }
  if (coverage == Coverage::kNone || residency_ == nullptr) return coverage;
  const Coverage resident = residency_->refinedCoverage(level, cells);
  if (resident == Coverage::kNone) residency_->noteRefused(level, cells);
  return coarserCoverage(coverage, resident);
}

CellState LeafClassifier::state(int level, const Index3& cell) {
  if (!contains({Index3(0), lattice_.cells(level)}, cell)) return CellState::kOutside;
  if (!refines(level + 1, cell / std::int64_t{2})) return CellState::kCoarser;
  return level > 0 && refines(level, cell) ? CellState::kFiner : CellState::kLeaf;
}

// The cells of the row that exist.
const std::uint64_t* LeafClassifier::existingRow(int level, const Index3& first,
                                                 std::int64_t count) {
  const std::int64_t words = wordsOf(count);
  if (first_x_ != first.x || count_ != count) {
    first_x_ = first.x;
    count_ = count;
    parent_rows_.fill({});
    exists_.resize(parent_rows_.size() * static_cast<std::size_t>(words));
  }
  const Index3 parent = first / std::int64_t{2};
  const std::int64_t place = parent.z % kParentRows * kParentRows + parent.y % kParentRows;
  ParentRow& row = parent_rows_[static_cast<std::size_t>(place)];
  std::uint64_t* exists = exists_.data() + place * words;
  if (row.level != level || row.first != parent) {
    row = {};  // should an oracle throw
    const std::int64_t parents = (first.x + count - 1) / 2 - parent.x + 1;
    parents_.resize(static_cast<std::size_t>(wordsOf(parents)));
    setBits(parents_.data(), parents);
    keepRefined(level + 1, parent, parents, parents_.data());
    doubleBits(parents_.data(), parents, first.x % 2, count, exists);
    row = {level, parent};
  }
  return exists;
}

const std::uint64_t* LeafClassifier::classifyRow(int level, const Index3& first, std::int64_t count,
                                                 std::uint64_t* refined) {
  const std::uint64_t* const exists = existingRow(level, first, count);
  for (std::int64_t word = 0; word < wordsOf(count); ++word)
    refined[word] = level > 0 ? exists[word] : 0;
  if (level > 0) keepRefined(level, first, count, refined);
  return exists;
}

void LeafClassifier::classifyRows(int level, const Index3& first, std::int64_t count,
                                  std::size_t rows, CellSpan* existing, CellSpan* refined) const {
  const FocusOracle& focus = choices_[0].shared.focus;
  const IndexBox parents = parentsOf({first, Index3(count, rows, 1)});
  CellSpan of_parents[SphereRows::kMost];
  focus.refinedSpans(level + 1, parents.first, parents.count.x,
                     static_cast<std::size_t>(parents.count.y), of_parents);
  for (std::size_t row = 0; row < rows; ++row) {
    const auto of = (first.y + static_cast<std::int64_t>(row)) / 2 - parents.first.y;
    const auto [begin, end] = of_parents[of];
    existing[row] = {std::max<std::int64_t>(2 * begin - first.x % 2, 0),
                     std::min(2 * end - first.x % 2, count)};
  }
  if (level > 0)
    focus.refinedSpans(level, first, count, rows, refined);
  else
    std::fill(refined, refined + rows, CellSpan{0, 0});
}

bool LeafClassifier::mayHoldLeaf(int level, const IndexBox& cells) const {
  return refinedCoverage(level + 1, parentsOf(cells)) != Coverage::kNone &&
         refinedCoverage(level, cells) != Coverage::kAll;
}

bool LeafClassifier::mayRefine(int level, const IndexBox& cells) const {
  return refinedCoverage(level, cells) != Coverage::kNone;
}

bool LeafClassifier::areAllLeaves(int level, const IndexBox& cells) const {
  const Index3 first = glm::max(cells.first - Index3(1), Index3(0));
  const Index3 end = glm::min(cells.end() + Index3(1), lattice_.cells(level));
  const IndexBox ring{first, end - first};
  return refinedCoverage(level + 1, parentsOf(ring)) == Coverage::kAll && !mayRefine(level, ring);
}

}  // namespace isobrick
