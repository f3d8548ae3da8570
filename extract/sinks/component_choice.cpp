#include "isobrick/extract/sinks/component_choice.h"

#include <atomic>
#include <utility>

namespace isobrick {
namespace {

constexpr double kSeedReachCells = 4.0;
constexpr double kMostGrowth = 4.0;

// Gives up beyond a number of triangles.
class BoundedFinder : public ComponentFinder {
 public:
  BoundedFinder(const Query& query, ComponentPoints points, std::uint64_t most)
      : ComponentFinder(query, std::move(points)), most_(most) {}

  void prepare(PlacedBatch& placed) override {
    const std::uint64_t triangles = triangles_ += placed.batch.triangles.size() / 3;
    if (most_ > 0 && triangles > most_) throw TooManyTriangles{triangles};
    ComponentFinder::prepare(placed);
  }

 private:
  const std::uint64_t most_;
  std::atomic<std::uint64_t> triangles_{0};
};

}  // namespace

ComponentPoints pointsOf(const PieceChoice& choice) {
  ComponentPoints points;
  points.reach = kSeedReachCells;
  for (const auto* seeds : {&choice.keep, &choice.hide})
    for (const ComponentSeed& seed : *seeds) points.points.push_back(seed.point);
  return points;
}

ChosenComponents chosenAmong(const SurfaceComponents& components, const PieceChoice& choice) {
  return chosenAmong(components.list(), components.atPoints(), choice);
}

ChosenComponents chosenAmong(const std::vector<SurfaceComponent>& list,
                             const std::vector<std::optional<std::size_t>>& places,
                             const PieceChoice& choice) {
  ChosenComponents chosen;
  chosen.is_kept.assign(list.size(), 0);
  auto found = places.begin();
  bool keeps_some = false;
  for (std::size_t i = 0; i < choice.keep.size(); ++i, ++found) {
    if (*found) chosen.is_kept[**found] = 1;
    keeps_some = keeps_some || *found;
    chosen.lost += *found ? 0 : 1;
  }
  if (!keeps_some)
    for (std::size_t i = 0; i < list.size(); ++i)
      chosen.is_kept[i] = list[i].area >= choice.least_area ? 1 : 0;
  for (std::size_t i = 0; i < choice.hide.size(); ++i, ++found) {
    if (!*found || list[**found].area > kMostGrowth * choice.hide[i].area)
      ++chosen.lost;
    else if (!keeps_some)
      chosen.is_kept[**found] = 0;
  }
  return chosen;
}

ChosenExtraction extractChosen(Extractor& extractor, Query query, const PieceChoice& choice,
                               TriangleSink& sink, std::uint64_t most_triangles,
                               const ComponentNumbers* numbers) {
  query.is_progressive = false;
  const ExtractionPlan plan = extractor.plan(query);
  BoundedFinder finder(query, pointsOf(choice), most_triangles);
  extractor.execute(plan, 0, plan.bricks().size(), finder);
  const SurfaceComponents components = finder.take();
  ChosenComponents chosen = chosenAmong(components, choice);
  ComponentFilter filter(components, std::move(chosen.is_kept), sink, numbers);
  return {extractor.execute(plan, 0, plan.bricks().size(), filter), chosen.lost};
}

}  // namespace isobrick
