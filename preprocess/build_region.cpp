#include "isobrick/preprocess/build_region.h"

#include "isobrick/preprocess/kernels/low_pass.h"

namespace isobrick {

BuildRegion::BuildRegion(const PyramidSpec& spec, const std::optional<DividedFile>& file)
    : spec_(spec), needs_(spec), rows_(file ? file->rows() : TableRows(needs_.layout())) {
  passOn();
}

// From the top down: a level passes on what the next one takes, its own bricks and those around
// them.
void BuildRegion::passOn() {
  const int levels = endLevel() - firstLevel();
  read_.resize(static_cast<std::size_t>(levels));
  passed_.resize(static_cast<std::size_t>(levels));
  const std::int64_t half = spec_.brick_cells / 2;
  IndexBox next;  // samples of level + 1
  for (int level = endLevel() - 1; level >= firstLevel(); --level) {
    const IndexBox& own = rows_.bricks(level);
    if (level + 1 < layout().lattice().levels()) next = unionOf(next, needs_.handedOn(level, own));
    passed_[place(level)] = next;
    // handedOn() gives each brick `half` samples, and the last one of an axis the rest.
    read_[place(level)] = own;
    if (next.size() > 0) {
      const Index3 first = glm::min(next.first / half, own.first);
      const Index3 end =
          glm::min(BrickLayout::ceilDivide(next.end(), half), layout().bricks(level));
      read_[place(level)] = {first, glm::max(end, own.end()) - first};
    }
    next = samples(level, read_[place(level)]);
  }
}

IndexBox BuildRegion::passedSamples(int level) const {
  if (level < firstLevel()) return {Index3(0), layout().lattice().samples(level + 1)};
  return passed_[place(level)];
}

IndexBox BuildRegion::passedTiles(int level) const {
  if (level < firstLevel()) return needs_.tiles(level, {Index3(0), layout().bricks(level)});
  return needs_.tiles(level, rows_.bricks(level));
}

IndexBox BuildRegion::samples(int level, const IndexBox& bricks) const {
  const IndexBox own = intersectionOf(bricks, rows_.bricks(level));
  const IndexBox passed = handedOn(level, bricks);
  IndexBox box;
  if (own.size() > 0) box = needs_.samples(level, own);
  if (passed.size() > 0)
    box = unionOf(box, lowPassSupport(layout().lattice(), level, spec_.filter, passed));
  return box;
}

IndexBox BuildRegion::handedOn(int level, const IndexBox& bricks) const {
  if (passed_[place(level)].size() == 0) return {};
  return intersectionOf(needs_.handedOn(level, bricks), passed_[place(level)]);
}

}  // namespace isobrick
