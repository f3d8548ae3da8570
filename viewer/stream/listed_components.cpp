#include "isobrick/viewer/stream/listed_components.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <span>
#include <utility>

#include "isobrick/extract/sinks/batch_components.h"
#include "isobrick/extract/sinks/nearest_parts.h"

namespace isobrick {
namespace {

// Gives up beyond a number of triangles.
class ListingFinder : public ComponentFinder {
 public:
  ListingFinder(const Query& query, std::uint64_t most_triangles)
      : ComponentFinder(query), most_triangles_(most_triangles) {}

  void prepare(PlacedBatch& placed) override {
    const std::uint64_t triangles = triangles_ += placed.batch.triangles.size() / 3;
    if (most_triangles_ > 0 && triangles > most_triangles_) throw TooManyTriangles{triangles};
    ComponentFinder::prepare(placed);
  }

 private:
  const std::uint64_t most_triangles_;
  std::atomic<std::uint64_t> triangles_{0};
};

// Finds which component of a list is nearest to one point.
class NearestInBrick : public TriangleSink {
 public:
  NearestInBrick(const SurfaceComponents& components, const GridGeometry& geometry,
                 const glm::dvec3& point, double reach)
      : components_(components),
        placement_(geometry),
        nearest_({point}, reach,
                 std::max({geometry.spacing.x, geometry.spacing.y, geometry.spacing.z})) {}

  void write(PlacedBatch& placed) override {
    const MeshBatch& batch = placed.batch;
    const std::span<const std::uint32_t> places = components_.ofBatch(batch);
    const std::uint32_t count = labelComponents(batch, placed.numbers);
    if (places.size() != count)
      throw Error("the surface has pieces that were not there when they were listed");
    placed.world.resize(batch.positions.size());
    for (std::uint32_t v = 0; v < placed.world.size(); ++v) {
      placed.world[v] = placement_.worldPosition(batch, v);
      placed.numbers[v] = places[placed.numbers[v]];
    }
    nearest_.add(batch, placed.world, placed.numbers, 0);
  }
  const NearestParts::Nearest& nearest() const { return nearest_.nearest().front(); }

 private:
  const SurfaceComponents& components_;
  const WorldPlacement placement_;
  NearestParts nearest_;
};

std::uint64_t nextListNumber() {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

Query queryOfLevel(double isovalue, int level, const CancelFlag* cancel) {
  Query query;
  query.isovalue = isovalue;
  query.uniform_level = level;
  query.cancel = cancel;
  return query;
}

}  // namespace

std::optional<int> onlyLevelOf(const Query& query) {
  const bool is_whole = !query.focus && !query.view && !query.curvature_tolerance &&
                        query.or_finer.empty() && !query.box && !query.cap && !query.simplify;
  return is_whole ? std::optional(query.uniform_level.value_or(0)) : std::nullopt;
}

ListedComponents::ListedComponents(Extractor& extractor, const Pyramid& pyramid,
                                   const ListingQuery& wanted)
    : number_(nextListNumber()),
      isovalue_(wanted.isovalue),
      level_(wanted.level),
      geometry_(pyramid.spec().geometry),
      layout_(pyramid.layout()) {
  Query query = queryOfLevel(isovalue_, level_, wanted.cancel);
  query.fraction_done = wanted.fraction_done;
  ListingFinder finder(query, wanted.most_triangles);
  extractor.extract(query, finder);
  components_ = finder.take();
}

// Brick by brick, the nearest first, until the rest is further away than what was found.
std::optional<std::size_t> ListedComponents::nearestTo(Extractor& extractor,
                                                       const ExtractionPlan& plan,
                                                       const glm::dvec3& point,
                                                       double reach) const {
  // Directions are orthonormal, so distances are those of the world.
  const glm::dvec3 place = glm::transpose(geometry_.direction) * (point - geometry_.origin);
  const Lattice& lattice = layout_.lattice();
  std::vector<std::pair<double, std::size_t>> bricks;  // by the square of their distance
  for (std::size_t i = 0; i < plan.bricks().size(); ++i) {
    const IndexBox cells = layout_.brickCellBox(level_, plan.bricks()[i].brick);
    const glm::dvec3 lower = geometry_.spacing * glm::dvec3(lattice.position(level_, cells.first));
    const glm::dvec3 upper = geometry_.spacing * glm::dvec3(lattice.position(level_, cells.end()));
    const glm::dvec3 away = glm::max(glm::max(lower - place, place - upper), 0.0);
    bricks.emplace_back(glm::dot(away, away), i);
  }
  std::ranges::make_heap(bricks, std::greater());
  NearestInBrick found(components_, geometry_, point, reach);
  const double edge = std::max({geometry_.spacing.x, geometry_.spacing.y, geometry_.spacing.z});
  const double most = std::ldexp(reach * edge, level_);
  while (!bricks.empty() &&
         bricks.front().first <= std::min(found.nearest().squared_distance, most * most)) {
    extractor.execute(plan, bricks.front().second, 1, found);
    std::ranges::pop_heap(bricks, std::greater());
    bricks.pop_back();
  }
  if (!std::isfinite(found.nearest().squared_distance)) return std::nullopt;
  return found.nearest().part;
}

std::vector<std::optional<std::size_t>> ListedComponents::nearest(Extractor& extractor,
                                                                  const ComponentPoints& points,
                                                                  const CancelFlag* cancel) const {
  std::vector<std::optional<std::size_t>> found;
  if (points.points.empty()) return found;
  const ExtractionPlan plan = extractor.plan(queryOfLevel(isovalue_, level_, cancel));
  for (const glm::dvec3& point : points.points)
    found.push_back(nearestTo(extractor, plan, point, points.reach));
  return found;
}

ChosenComponents ListedComponents::chosen(Extractor& extractor, const PieceChoice& choice,
                                          const CancelFlag* cancel) const {
  const ComponentPoints points = pointsOf(choice);
  std::vector<std::optional<std::size_t>> found(points.points.size());
  ComponentPoints others{{}, points.reach};
  std::vector<std::size_t> of_others;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const auto piece = std::ranges::find(list(), points.points[i], &SurfaceComponent::point);
    if (piece != list().end()) {
      found[i] = static_cast<std::size_t>(piece - list().begin());
    } else {
      others.points.push_back(points.points[i]);
      of_others.push_back(i);
    }
  }
  const auto near = nearest(extractor, others, cancel);
  for (std::size_t i = 0; i < near.size(); ++i) found[of_others[i]] = near[i];
  return chosenAmong(list(), found, choice);
}

void ListedNumbers::find(const MeshBatch& batch, std::vector<std::uint32_t>& numbers) const {
  // Caps join pieces that the list has apart.
  if (!batch.is_uniform || batch.level != listed_.level_ || batch.cap_indices > 0) {
    numbers.assign(batch.positions.size(), kNoComponent);
    return;
  }
  const std::uint32_t count = labelComponents(batch, numbers);
  const std::span<const std::uint32_t> places = listed_.components_.ofBatch(batch);
  if (places.size() != count)
    throw Error("the surface has pieces that were not there when they were listed");
  for (std::uint32_t& number : numbers) number = places[number];
}

std::shared_ptr<const ListedComponents> KnownComponents::find(double isovalue, int level) {
  const std::lock_guard lock(mutex_);
  return known({isovalue, level});
}

// With the lock.
std::shared_ptr<const ListedComponents> KnownComponents::known(const Surface& surface) {
  const auto found = std::ranges::find_if(lists_, [&](const auto& listed) {
    return Surface(listed->isovalue(), listed->level()) == surface;
  });
  if (found == lists_.end()) return nullptr;
  lists_.splice(lists_.begin(), lists_, found);
  return lists_.front();
}

std::shared_ptr<const ListedComponents> KnownComponents::findOrList(Extractor& extractor,
                                                                    const Pyramid& pyramid,
                                                                    const ListingQuery& query) {
  if (auto known = begin(query)) return known;
  const Surface surface(query.isovalue, query.level);
  try {
    auto listed = std::make_shared<const ListedComponents>(extractor, pyramid, query);
    ++listings_;
    end(surface, listed);
    return listed;
  } catch (...) {
    end(surface, nullptr);
    throw;
  }
}

// Null: the caller makes the list, and calls end().
std::shared_ptr<const ListedComponents> KnownComponents::begin(const ListingQuery& query) {
  constexpr std::chrono::milliseconds kLookForCancel(5);
  const Surface surface(query.isovalue, query.level);
  std::unique_lock lock(mutex_);
  while (true) {
    if (auto found = known(surface)) return found;
    if (under_way_.insert(surface).second) return nullptr;
    ended_.wait_for(lock, kLookForCancel);
    if (query.cancel != nullptr) query.cancel->check();
  }
}

// `listed`: null if there is none.
void KnownComponents::end(const Surface& surface,
                          const std::shared_ptr<const ListedComponents>& listed) {
  {
    const std::lock_guard lock(mutex_);
    under_way_.erase(surface);
    if (listed) lists_.push_front(listed);
    std::uint64_t bytes = 0;
    for (auto kept = lists_.begin(); kept != lists_.end();) {
      bytes += (*kept)->bytes();
      kept = kept != lists_.begin() && bytes > most_bytes_ ? lists_.erase(kept) : std::next(kept);
    }
  }
  ended_.notify_all();
}

}  // namespace isobrick
