#include "isobrick/extract/sinks/surface_components.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <glm/vector_relational.hpp>
#include <limits>
#include <mutex>
#include <numeric>
#include <utility>

#include "isobrick/extract/sinks/batch_components.h"
#include "isobrick/extract/sinks/edge_vertex_map.h"
#include "isobrick/extract/sinks/nearest_parts.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// The volume between a surface and the border of a box that begins at the origin, in voxels: the
// flux of (x, 0, 0), to which the sides of the box add that of the last x alone. The area inside
// there is that between the surface's border and the line of the last y, by Green's theorem, and
// the length inside on that line goes from end to end.
struct CappedVolume {
  double flux = 0, area = 0, length = 0;
  std::int64_t begins = 0;  // on the line; one more than ends if its last point is inside

  void addTriangle(const std::array<glm::dvec3, 3>& at, const glm::dvec3& last) {
    const glm::dvec3 ab = at[1] - at[0], ac = at[2] - at[0];
    flux += (at[0].x + at[1].x + at[2].x) * (ab.y * ac.z - ab.z * ac.y) / 6;
    for (std::size_t i = 0; i < 3; ++i) {
      const glm::dvec3 &a = at[i], &b = at[(i + 1) % 3];
      // A side in the box's side is the surface's border, or is there twice, both ways.
      if (a.x != last.x || b.x != last.x) continue;
      area += (a.y + b.y) * (a.z - b.z) / 2;
      if (a.y == last.y) length -= a.z, ++begins;
      if (b.y == last.y) length += b.z, --begins;
    }
  }
  void add(const CappedVolume& other) {
    flux += other.flux;
    area += other.area;
    length += other.length;
    begins += other.begins;
  }
  // The lesser of its two sides: a pocket at the border does not enclose all the rest.
  double volume(const glm::dvec3& last) const {
    const double to_end = length + static_cast<double>(begins) * last.z;
    const double sum = flux + last.x * (area + last.y * to_end);
    const double all = last.x * last.y * last.z;
    const double inside = sum < 0 ? sum + all : sum;
    return std::min(inside, all - inside);
  }
};

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
  CappedVolume capped;

  void add(const ComponentPart& other) {
    triangles += other.triangles;
    area += other.area;
    if (triangles == other.triangles) point = other.point;
    volume += other.volume;
    moment += other.moment;
    lower = glm::min(lower, other.lower);
    upper = glm::max(upper, other.upper);
    has_border = has_border || other.has_border;
    capped.add(other.capped);
  }
};

std::uint64_t keyOfBrick(const MeshBatch& batch) {
  const Index3& b = batch.brick;
  return static_cast<std::uint64_t>(((batch.level << 19 | b.z) << 19 | b.y) << 19 | b.x);
}

constexpr std::size_t kNoBody = ~std::size_t{0};

bool isCavity(const SurfaceComponent& one) { return one.volume && *one.volume < 0; }

// The body of the least box that holds that of the cavity.
std::size_t bodyAround(const std::vector<SurfaceComponent>& list, const SurfaceComponent& cavity) {
  std::size_t found = kNoBody;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < list.size(); ++i) {
    const glm::dvec3 extent = list[i].upper - list[i].lower;
    const double box = extent.x * extent.y * extent.z;
    if (isCavity(list[i]) || !(box < least) ||
        glm::any(glm::greaterThan(list[i].lower, cavity.lower)) ||
        glm::any(glm::lessThan(list[i].upper, cavity.upper)))
      continue;
    found = i;
    least = box;
  }
  return found;
}

}  // namespace

std::size_t SurfaceComponents::countFrom(double area) const {
  return static_cast<std::size_t>(
      std::find_if(list_.begin(), list_.end(), [&](const auto& c) { return c.area < area; }) -
      list_.begin());
}

std::vector<std::uint8_t> SurfaceComponents::kept(std::optional<std::size_t> count,
                                                  double least_area) const {
  if (count) return largest(*count, least_area);
  std::vector<std::uint8_t> is_kept(list_.size(), 0);
  std::fill_n(is_kept.begin(), countFrom(least_area), std::uint8_t{1});
  return is_kept;
}

std::vector<std::uint8_t> SurfaceComponents::largest(std::size_t count, double least_area) const {
  std::vector<std::size_t> body_of(list_.size()), bodies;
  std::vector<double> sizes(list_.size(), 0.0);
  for (std::size_t i = 0; i < list_.size(); ++i) {
    const SurfaceComponent& one = list_[i];
    body_of[i] = isCavity(one) ? bodyAround(list_, one) : i;
    if (body_of[i] == i && one.area >= least_area) bodies.push_back(i);
    if (body_of[i] != kNoBody) sizes[body_of[i]] += one.enclosed.value_or(one.area);
  }
  std::ranges::stable_sort(bodies, std::greater(), [&](std::size_t i) { return sizes[i]; });
  bodies.resize(std::min(bodies.size(), count));
  std::vector<std::uint8_t> is_kept(list_.size(), 0);
  for (const std::size_t body : bodies) is_kept[body] = 1;
  for (std::size_t i = 0; i < list_.size(); ++i)
    if (body_of[i] != kNoBody && is_kept[body_of[i]] != 0) is_kept[i] = 1;
  return is_kept;
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
    : is_capped_(query.cap),
      is_cut_((query.box || !query.region.isEverywhere()) && !query.cap),
      points_(std::move(points)) {}
ComponentFinder::~ComponentFinder() = default;

void ComponentFinder::begin(const MeshFrame& frame) {
  frame_ = frame;
  is_cut_ = is_cut_ || frame.has_missing;
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
  const auto voxelOf = [&](std::uint32_t v) {
    return glm::dvec3(batch.origin) + glm::dvec3(batch.positions[v]);
  };
  const bool is_mirrored = glm::determinant(frame_.geometry.direction) < 0;
  placed.world.resize(batch.positions.size());
  for (std::uint32_t v = 0; v < batch.positions.size(); ++v) {
    const glm::dvec3 voxel = voxelOf(v);
    placed.world[v] = placement_.worldPosition(batch, v);
    ComponentPart& part = parts[placed.numbers[v]];
    part.lower = glm::min(part.lower, placed.world[v]);
    part.upper = glm::max(part.upper, placed.world[v]);
    part.has_border |= !is_capped_ && (glm::any(glm::equal(voxel, glm::dvec3(0.0))) ||
                                       glm::any(glm::equal(voxel, last)));
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
    std::array<glm::dvec3, 3> at = {voxelOf(batch.triangles[i]), voxelOf(batch.triangles[i + 1]),
                                    voxelOf(batch.triangles[i + 2])};
    if (is_mirrored) std::swap(at[1], at[2]);
    part.capped.addTriangle(at, last);
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
  const glm::dvec3 last(frame_.voxels - Index3(1));
  const glm::dvec3& spacing = frame_.geometry.spacing;
  const double voxel = spacing.x * spacing.y * spacing.z;
  std::ranges::stable_sort(order, [&](auto a, auto b) { return sums[a].area > sums[b].area; });
  for (std::uint32_t place = 0; place < order.size(); ++place) {
    const ComponentPart& sum = sums[order[place]];
    places[order[place]] = place;
    SurfaceComponent listed;
    listed.triangles = sum.triangles;
    listed.area = sum.area;
    if (!sum.has_border && !is_cut_) listed.volume = sum.volume;
    if (!is_cut_) listed.enclosed = sum.has_border ? sum.capped.volume(last) * voxel : sum.volume;
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
