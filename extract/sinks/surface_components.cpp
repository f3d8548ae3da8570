#include "isobrick/extract/sinks/surface_components.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <mutex>
#include <numeric>
#include <utility>

#include "isobrick/extract/sinks/batch_components.h"
#include "isobrick/extract/sinks/disjoint_sets.h"
#include "isobrick/extract/sinks/edge_vertex_map.h"
#include "isobrick/extract/sinks/nearest_parts.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// A component of a batch, or of the surface.
struct ComponentPart {
  std::uint64_t triangles = 0;
  double area = 0;
  double volume = 0;  // of the cone from the volume's centre over its triangles
  glm::dvec3 lower{std::numeric_limits<double>::infinity()};
  glm::dvec3 upper{-std::numeric_limits<double>::infinity()};
  glm::dvec3 moment{0.0};  // of the area, about the world's origin of the placement
  glm::dvec3 point{0.0};   // its first vertex
  bool has_border = false;

  void add(const ComponentPart& other) {
    triangles += other.triangles;
    area += other.area;
    if (triangles == other.triangles) point = other.point;
    volume += other.volume;
    moment += other.moment;
    lower = glm::min(lower, other.lower);
    upper = glm::max(upper, other.upper);
    has_border = has_border || other.has_border;
  }
};

std::uint64_t keyOfBrick(const MeshBatch& batch) {
  const Index3& b = batch.brick;
  return static_cast<std::uint64_t>(((batch.level << 19 | b.z) << 19 | b.y) << 19 | b.x);
}

}  // namespace

std::size_t SurfaceComponents::countFrom(double area) const {
  return static_cast<std::size_t>(
      std::find_if(list_.begin(), list_.end(), [&](const auto& c) { return c.area < area; }) -
      list_.begin());
}

std::span<const std::uint32_t> SurfaceComponents::ofBatch(const MeshBatch& batch) const {
  const std::uint64_t key = keyOfBrick(batch);
  const auto found = std::ranges::lower_bound(batches_, key, {}, &Batch::key);
  if (found == batches_.end() || found->key != key) return {};
  return std::span(of_part_).subspan(found->first, found->count);
}

std::uint64_t SurfaceComponents::bytes() const {
  return list_.size() * sizeof(SurfaceComponent) + batches_.size() * sizeof(Batch) +
         of_part_.size() * sizeof(std::uint32_t);
}

// Parts are numbered in the order of the extraction, and joined along the vertices that batches
// share.
struct ComponentFinder::Joined {
  std::mutex mutex;  // guards the parts
  std::vector<ComponentPart> parts;
  std::vector<std::uint32_t> parents;  // of parts
  SharedVertexMap shared;              // with the parts that they were first met in
  std::optional<NearestParts> nearest;
};

ComponentFinder::ComponentFinder(const Query& query, ComponentPoints points)
    : has_box_(query.box.has_value()), points_(std::move(points)) {}
ComponentFinder::~ComponentFinder() = default;

void ComponentFinder::begin(const MeshFrame& frame) {
  frame_ = frame;
  // Volumes far from the origin would lose digits; any point does.
  GridGeometry geometry = frame.geometry;
  geometry.origin = glm::dvec3(0.0);
  placement_ = WorldPlacement(geometry);
  joined_ = std::make_unique<Joined>();
  std::vector<glm::dvec3> points = points_.points;
  for (glm::dvec3& point : points) point -= frame.geometry.origin;
  const glm::dvec3& spacing = geometry.spacing;
  joined_->nearest.emplace(std::move(points), points_.reach,
                           std::max({spacing.x, spacing.y, spacing.z}));
  components_ = {};
}

void ComponentFinder::prepare(PlacedBatch& placed) {
  const std::uint32_t count = labelComponents(placed.batch, placed.numbers);
  placed.numbers.push_back(count);  // behind the numbers of the vertices
}

void ComponentFinder::place(PlacedBatch& placed) {
  const std::size_t first = joined_->parts.size();
  const std::size_t count = placed.numbers.back();
  if (first + count > std::numeric_limits<std::uint32_t>::max())
    throw Error("the surface has more than 4 billion pieces in bricks; ask for a coarser level");
  {
    const std::lock_guard lock(joined_->mutex);
    joined_->parts.resize(first + count);
  }
  joined_->parents.resize(first + count);
  std::iota(joined_->parents.begin() + static_cast<std::ptrdiff_t>(first), joined_->parents.end(),
            static_cast<std::uint32_t>(first));
  for (const MeshBatch::SharedVertex& vertex : placed.batch.shared) {
    const std::size_t part = first + placed.numbers[vertex.vertex];
    if (const auto other = joined_->shared.meet(vertex, part))
      joinSets(joined_->parents, static_cast<std::uint32_t>(part),
               static_cast<std::uint32_t>(*other));
  }
  components_.batches_.push_back(
      {keyOfBrick(placed.batch), first, static_cast<std::uint32_t>(count)});
  placed.first_vertex = first;
}

void ComponentFinder::write(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  std::vector<ComponentPart> parts(placed.numbers.back());
  const glm::dvec3 last(frame_.voxels - Index3(1));
  placed.world.resize(batch.positions.size());
  for (std::uint32_t v = 0; v < batch.positions.size(); ++v) {
    const glm::dvec3 voxel = glm::dvec3(batch.origin) + glm::dvec3(batch.positions[v]);
    placed.world[v] = placement_.worldPosition(batch, v);
    ComponentPart& part = parts[placed.numbers[v]];
    part.lower = glm::min(part.lower, placed.world[v]);
    part.upper = glm::max(part.upper, placed.world[v]);
    part.has_border |=
        glm::any(glm::equal(voxel, glm::dvec3(0.0))) || glm::any(glm::equal(voxel, last));
  }
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
    const glm::dvec3& a = placed.world[batch.triangles[i]];
    const glm::dvec3& b = placed.world[batch.triangles[i + 1]];
    const glm::dvec3& c = placed.world[batch.triangles[i + 2]];
    const glm::dvec3 across = glm::cross(b - a, c - a);
    ComponentPart& part = parts[placed.numbers[batch.triangles[i]]];
    ++part.triangles;
    const double area = glm::length(across) / 2;
    if (part.triangles == 1) part.point = a;
    part.area += area;
    part.moment += area / 3 * (a + b + c);
    part.volume += glm::dot(a, across) / 6;
  }
  joined_->nearest->add(batch, placed.world, placed.numbers, placed.first_vertex);
  const std::lock_guard lock(joined_->mutex);
  std::ranges::copy(parts,
                    joined_->parts.begin() + static_cast<std::ptrdiff_t>(placed.first_vertex));
}

void ComponentFinder::finish() {
  // The least part of a component is its root, and comes before the others.
  std::vector<std::uint32_t> component(joined_->parts.size());
  std::vector<ComponentPart> sums;
  for (std::uint32_t part = 0; part < component.size(); ++part) {
    const std::uint32_t root = rootOf(joined_->parents, part);
    if (root == part) {
      component[part] = static_cast<std::uint32_t>(sums.size());
      sums.emplace_back();
    } else {
      component[part] = component[root];
    }
    sums[component[part]].add(joined_->parts[part]);
  }
  std::vector<std::uint32_t> order(sums.size()), places(sums.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::stable_sort(order, [&](auto a, auto b) { return sums[a].area > sums[b].area; });
  for (std::uint32_t place = 0; place < order.size(); ++place) {
    const ComponentPart& sum = sums[order[place]];
    places[order[place]] = place;
    SurfaceComponent listed;
    listed.triangles = sum.triangles;
    listed.area = sum.area;
    if (!sum.has_border && !has_box_) listed.volume = sum.volume;
    listed.lower = sum.lower + frame_.geometry.origin;
    listed.upper = sum.upper + frame_.geometry.origin;
    listed.center = (sum.area > 0 ? sum.moment / sum.area : sum.point) + frame_.geometry.origin;
    listed.point = sum.point + frame_.geometry.origin;
    components_.list_.push_back(listed);
  }
  for (std::uint32_t& of : component) of = places[of];
  for (const NearestParts::Nearest& near : joined_->nearest->nearest())
    components_.at_points_.push_back(std::isfinite(near.squared_distance)
                                         ? std::optional<std::size_t>(component[near.part])
                                         : std::nullopt);
  components_.of_part_ = std::move(component);
  std::ranges::sort(components_.batches_, {}, &SurfaceComponents::Batch::key);
  joined_.reset();
}

namespace {

std::vector<std::uint8_t> firstOnes(std::size_t all, std::size_t count) {
  std::vector<std::uint8_t> result(all, 0);
  std::fill_n(result.begin(), std::min(all, count), std::uint8_t{1});
  return result;
}

}  // namespace

ComponentFilter::ComponentFilter(const SurfaceComponents& components, std::size_t count,
                                 TriangleSink& sink)
    : ComponentFilter(components, firstOnes(components.list().size(), count), sink) {}

ComponentFilter::ComponentFilter(const SurfaceComponents& components,
                                 std::vector<std::uint8_t> is_kept, TriangleSink& sink,
                                 const ComponentNumbers* numbers)
    : components_(components), is_kept_(std::move(is_kept)), sink_(sink), numbers_(numbers) {}

void ComponentFilter::prepare(PlacedBatch& placed) {
  MeshBatch& batch = placed.batch;
  const std::span<const std::uint32_t> places = components_.ofBatch(batch);
  std::vector<std::uint8_t> is_kept(labelComponents(batch, placed.numbers));
  if (places.empty() || places.size() != is_kept.size())
    throw Error(
        "the surface has pieces that were not there when they were listed; extract it again");
  for (std::size_t i = 0; i < is_kept.size(); ++i) is_kept[i] = is_kept_.at(places[i]);
  if (numbers_ != nullptr) {
    numbers_->find(batch, placed.components);
  } else {
    placed.components.resize(batch.positions.size());
    for (std::size_t v = 0; v < placed.components.size(); ++v)
      placed.components[v] = places[placed.numbers[v]];
  }
  if (keepComponents(batch, placed.numbers, is_kept)) {
    // Kept vertices keep their order.
    for (std::size_t v = 0; v < placed.numbers.size(); ++v)
      if (placed.numbers[v] != kDroppedVertex)
        placed.components[placed.numbers[v]] = placed.components[v];
    placed.components.resize(batch.positions.size());
  }
  if (!batch.triangles.empty()) sink_.prepare(placed);
}

}  // namespace isobrick
