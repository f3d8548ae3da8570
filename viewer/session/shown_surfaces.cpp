#include "isobrick/viewer/session/shown_surfaces.h"

#include <algorithm>
#include <utility>

namespace isobrick {
namespace {

void addCounts(const std::vector<LevelCounts>& counts, std::vector<LevelCounts>& sums) {
  for (const LevelCounts& count : counts) {
    const auto same = std::find_if(
        sums.begin(), sums.end(), [&](const LevelCounts& sum) { return sum.level == count.level; });
    LevelCounts& sum = same != sums.end() ? *same : sums.emplace_back();
    sum.level = count.level;
    sum.cells += count.cells;
    sum.triangles += count.triangles;
    sum.transition_cells += count.transition_cells;
  }
  std::sort(sums.begin(), sums.end(),
            [](const LevelCounts& a, const LevelCounts& b) { return a.level < b.level; });
}

}  // namespace

void ShownSurfaces::take(const StreamMessage& pass, const AskedView& asked) {
  std::map<int, Shown> shown;
  // One that is not known, since there was no memory for it, is asked for again.
  for (const StreamPass::KeptSurface& kept : pass.kept) {
    const auto before = surfaces_.find(kept.surface);
    if (before != surfaces_.end()) shown.insert(*before);
  }
  for (const StreamedSurface& made : pass.surfaces)
    shown[made.surface] = {asked, pass.radius, pass.is_complete, made};
  StreamMessage copy = pass;
  surfaces_ = std::move(shown);
  pass_ = std::move(copy);
  ++passes_;
}

bool ShownSurfaces::has(std::size_t surface, const AskedView& view, double least,
                        double most) const {
  const auto found = surfaces_.find(static_cast<int>(surface));
  if (found == surfaces_.end()) return false;
  const Shown& shown = found->second;
  return shown.is_complete && shown.radius >= least && shown.radius <= most &&
         asksForTheSameSurface(shown.asked.state, view.state, surface) &&
         shown.asked.listedOf(surface) == view.listedOf(surface) &&
         (!view.state.view_pixels || shown.asked.height == view.height);
}

std::uint64_t ShownSurfaces::triangles() const {
  std::uint64_t triangles = 0;
  for (const auto& [number, surface] : surfaces_) triangles += surface.counts.triangles;
  return triangles;
}

std::vector<LevelCounts> ShownSurfaces::levels() const {
  std::vector<LevelCounts> levels;
  for (const auto& [number, surface] : surfaces_) addCounts(surface.counts.levels, levels);
  return levels;
}

const StreamedSurface* ShownSurfaces::surface(std::size_t number) const {
  const auto found = surfaces_.find(static_cast<int>(number));
  return found != surfaces_.end() ? &found->second.counts : nullptr;
}

std::size_t ShownSurfaces::lostPieces() const {
  std::size_t lost = 0;
  for (const auto& [number, surface] : surfaces_) lost += surface.counts.lost_pieces;
  return lost;
}

}  // namespace isobrick
