#include "isobrick/extract/paging/missing_bricks.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <limits>
#include <unordered_set>
#include <utility>

#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

MeshContext withEverything(const MeshContext& context) {
  MeshContext whole = context;
  whole.residency = nullptr;
  return whole;
}

// True, too, as long as the brick's row is not at hand: it is not read for that.
bool mayCross(const MeshContext& context, int level, const Index3& brick) {
  return overlapsQueryBox(context, level, context.pyramid.layout().brickCellBox(level, brick)) &&
         (!context.pyramid.parts().isRowAtHand(level, brick) ||
          context.residency->needs().mayCross(level, brick));
}

class MissingBricks {
 public:
  explicit MissingBricks(const MeshContext& context)
      : context_(context), whole_(withEverything(context)), classifier_(whole_) {
    addPlace(context.query);
    for (const DetailChoice& choice : context.query.or_finer) addPlace(choice);
  }

  std::vector<MissingBrick> run() {
    visit(context_.lattice().levels() - 1, Index3(0));
    std::stable_sort(wanted_.begin(), wanted_.end(),
                     [](const Wanted& a, const Wanted& b) { return a.key < b.key; });
    for (const Wanted& wanted : wanted_) list(wanted.level, wanted.brick);
    const std::vector<MissingBrick>& refused = context_.residency->missing();
    missing_.insert(missing_.end(), refused.begin(), refused.end());
    return std::move(missing_);
  }

 private:
  struct Wanted {
    std::pair<double, int> key;
    int level;
    Index3 brick;
  };

  // Where the surface is to be finest, in voxels.
  void addPlace(const DetailChoice& choice) {
    if (choice.focus)
      places_.push_back(choice.focus->center);
    else if (choice.view)
      places_.push_back(context_.pyramid.spec().geometry.worldToIndex(choice.view->eye));
  }

  void visit(int level, const Index3& brick) {
    if (!mayCross(context_, level, brick)) return;
    const BrickLayout& layout = context_.pyramid.layout();
    const IndexBox cells = layout.brickCellBox(level, brick);
    const bool is_refined = classifier_.mayRefine(level, cells);
    if (!is_refined && !classifier_.mayHoldLeaf(level, cells)) return;
    wanted_.push_back({keyOf(level, cells), level, brick});
    if (!is_refined || !context_.pyramid.parts().isRowAtHand(level, brick)) return;
    forEachIndex(context_.finerBricks(level, brick),
                 [&](const Index3& child) { visit(level - 1, child); });
  }

  // The nearest first, and of these the finest. If there are no places, the coarsest first.
  std::pair<double, int> keyOf(int level, const IndexBox& cells) const {
    if (places_.empty()) return {0, -level};
    const glm::dvec3 low(context_.lattice().position(level, cells.first));
    const glm::dvec3 high(context_.lattice().position(level, cells.end()));
    double distance = std::numeric_limits<double>::infinity();
    for (const glm::dvec3& place : places_)
      distance = std::min(distance, glm::length(place - glm::clamp(place, low, high)));
    return {distance, level};
  }

  // After what the brick needs to be usable.
  void list(int level, const Index3& brick) {
    ResidencyOracle& residency = *context_.residency;
    if (!listed_.insert(context_.pyramid.parts().brickRow(level, brick)).second ||
        residency.isUsableNow(level, brick))
      return;
    residency.forEachParentAround(level, brick,
                                  [&](const Index3& parent) { list(level + 1, parent); });
    missing_.push_back({level, brick, false, residency.lacksParts(level, brick)});
  }

  const MeshContext& context_;
  const MeshContext whole_;
  const LeafClassifier classifier_;
  std::vector<glm::dvec3> places_;
  std::vector<Wanted> wanted_;
  std::unordered_set<std::size_t> listed_;  // by row of the brick table
  std::vector<MissingBrick> missing_;
};

}  // namespace

bool isWanted(const MeshContext& context, int level, const Index3& brick) {
  const MeshContext whole = withEverything(context);
  const LeafClassifier classifier(whole);
  const IndexBox cells = context.pyramid.layout().brickCellBox(level, brick);
  return mayCross(context, level, brick) &&
         (classifier.mayRefine(level, cells) || classifier.mayHoldLeaf(level, cells));
}

std::vector<MissingBrick> missingBricks(const MeshContext& context) {
  return MissingBricks(context).run();
}

}  // namespace isobrick
