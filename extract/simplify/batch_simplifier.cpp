#include "isobrick/extract/simplify/batch_simplifier.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <span>
#include <utility>

#include "isobrick/extract/crossing_grid.h"
#include "isobrick/extract/sinks/batch_components.h"

namespace isobrick {
namespace {

// The vertices of a star become one only if its triangles would lie closer to the finest ones than
// this part of the distance, in the mean of squares: so the edges that are left are nearly as good
// as they would be without stars.
constexpr float kMostMeanSquareOfStar = 0.02f;
// First go the edges that may go within this part of the distance, so that flat surfaces are large
// triangles before crooked edges use up the distance.
constexpr float kFirstPart = 1.0f / 32;
// The cheapest of so many candidates get their turn in a round; if there are few, all do.
constexpr std::size_t kCandidatesForEach = 2, kFewCandidates = 256;
// An edge is not tried if its triangles would lie further from the finest ones than this part of
// the distance, in the mean of squares: it would hardly ever be let through.
constexpr float kMostMeanSquare = 0.05f;
// The border is straightened by these parts of the distance, one after the other.
constexpr std::array kShiftsOfBorder = {1.0f / 64, 1.0f / 16, 1.0f / 4};
// So many steps lie between looks whether the query was cancelled.
constexpr std::size_t kBetweenLooks = 1024;
constexpr std::uint32_t kNone = CornerTable::kNone;
// Where triangles cross, the distance becomes a quarter so often, and then 0.
constexpr std::uint8_t kMostNarrowings = 3;

// Sides of a box that a vertex lies in: two bits an axis.
unsigned sidesOf(const glm::vec3& position, const glm::vec3& lower, const glm::vec3& upper) {
  unsigned sides = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (position[axis] == lower[axis]) sides |= 1u << (2 * axis);
    if (position[axis] == upper[axis]) sides |= 2u << (2 * axis);
  }
  return sides;
}

}  // namespace

SimplifySpace SimplifySpace::of(const SimplifyOptions& options, const GridGeometry& geometry,
                                const Index3& voxels) {
  // The world in units of the least spacing: squares of squares of its own might leave the floats.
  const double unit = geometry.leastSpacing();
  SimplifySpace space{
      .distance = static_cast<float>(options.in_world ? options.distance / unit : options.distance),
      .drops_small = options.drop_small,
      .voxels = voxels};
  const glm::dvec3& spacing = geometry.spacing;
  if (spacing == glm::dvec3(unit)) return space;
  // Turned as the index axes are.
  const glm::dmat3 to_space(glm::dvec3(spacing.x / unit, 0, 0), glm::dvec3(0, spacing.y / unit, 0),
                            glm::dvec3(0, 0, spacing.z / unit));
  space.to_space = to_space;
  space.to_voxels = glm::inverse(to_space);
  return space;
}

void BatchSimplifier::simplify(const SimplifySpace& space, const CancelFlag* cancel,
                               MeshBatch& batch, SimplifyRemains* remains) {
  if (space.drops_small) small_.drop(space.to_space, space.distance, batch);
  if (batch.triangles.empty()) return;
  collapseAll(space, cancel, batch, nullptr, [&] { addPlanes(); });
  write(batch);
  if (remains != nullptr) writeRemains(*remains);
}

void BatchSimplifier::simplifyGroup(const SimplifySpace& space, const CancelFlag* cancel,
                                    BatchGroup& group) {
  collapseAll(space, cancel, group.placed.batch, &group.is_seam,
              [&] { takeRemains(group.remains); });
  write(group.placed.batch);
}

template <typename Start>
void BatchSimplifier::collapseAll(const SimplifySpace& space, const CancelFlag* cancel,
                                  const MeshBatch& batch, const std::vector<std::uint8_t>* seams,
                                  const Start& start) {
  narrowings_.assign(batch.positions.size(), 0);
  // What crosses moved less than the distance; less is kept if less is enough.
  float reach = space.distance / 4;
  do {
    begin(space, batch);
    start();
    distance_ = kFirstPart * space.distance;
    findEdges(seams);
    collapseEdges(cancel, batch);
    distance_ = space.distance;
    if (seams == nullptr) collapseStars(cancel);
    findEdges(seams);
    collapseEdges(cancel, batch);
    for (const float part : kShiftsOfBorder)
      while (collapseBorders(cancel, batch, part * space.distance)) collapseEdges(cancel, batch);
    reach *= 2;
  } while (narrowAroundCrossings(batch, reach));
}

void BatchSimplifier::begin(const SimplifySpace& space, const MeshBatch& batch) {
  space_ = space;
  lower_ = upper_ = batch.positions[0];
  for (const glm::vec3& position : batch.positions) {
    lower_ = glm::min(lower_, position);
    upper_ = glm::max(upper_, position);
  }
  center_ = glm::round((lower_ + upper_) / 2.0f);
  grid_steps_ = std::ldexp(1.0f, kCrossingBits - batch.level);
  voxels_.assign(batch.positions.begin(), batch.positions.end());
  table_.set(batch.triangles, batch.positions.size());
  vertices_.assign(batch.positions.size(), Vertex());
  touched_.assign(batch.positions.size(), 0);
  for (const MeshBatch::SharedVertex& shared : batch.shared)
    vertices_[shared.vertex].is_shared = true;
  for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
    Vertex& vertex = vertices_[v];
    vertex.position = positionOf(batch.positions[v]);
    vertex.is_fixed = vertex.is_shared || table_.ring(v) != CornerTable::Ring::kClosed ||
                      narrowings_[v] == kMostNarrowings;
    vertex.is_border = !vertex.is_shared && table_.ring(v) == CornerTable::Ring::kOpen &&
                       narrowings_[v] < kMostNarrowings;
    vertex.is_broken = table_.ring(v) == CornerTable::Ring::kBroken;
  }
  normals_.assign(batch.normals.begin(), batch.normals.end());
  deviations_.assign(table_.triangles(), Deviation());
  round_ = 1;
  findCapPlanes(batch);
}

void BatchSimplifier::findCapPlanes(const MeshBatch& batch) {
  cap_planes_.clear();
  if (batch.cap_indices == 0) return;
  cap_planes_.resize(vertices_.size());
  for (std::size_t i = batch.triangles.size() - batch.cap_indices; i < batch.triangles.size();
       i += 3) {
    const std::span corners = std::span(batch.triangles).subspan(i, 3);
    for (int axis = 0; axis < 3; ++axis) {
      const auto at = [&](std::size_t corner) { return batch.positions[corners[corner]][axis]; };
      if (at(0) != at(1) || at(0) != at(2)) continue;
      for (const std::uint32_t v : corners) cap_planes_[v] |= static_cast<std::uint8_t>(1u << axis);
    }
  }
}

bool BatchSimplifier::keepInCapPlanes(std::span<const std::uint32_t> joined, glm::vec3& voxels) {
  if (cap_planes_.empty()) return true;
  unsigned kept = 0;
  for (const std::uint32_t v : joined)
    for (int axis = 0; axis < 3; ++axis) {
      if ((cap_planes_[v] >> axis & 1) == 0) continue;
      if ((kept >> axis & 1) != 0 && voxels[axis] != voxels_[v][axis]) return false;
      voxels[axis] = voxels_[v][axis];
      kept |= 1u << axis;
    }
  return true;
}

// Each triangle counts a third at each of its vertices.
void BatchSimplifier::addPlanes() {
  for (std::uint32_t t = 0; t < table_.triangles(); ++t) {
    const std::uint32_t c = CornerTable::firstCorner(t);
    const std::uint32_t corners[] = {table_.vertex(c), table_.vertex(c + 1), table_.vertex(c + 2)};
    const glm::vec3& a = vertices_[corners[0]].position;
    const glm::vec3 across =
        glm::cross(vertices_[corners[1]].position - a, vertices_[corners[2]].position - a);
    const float length = std::sqrt(glm::dot(across, across));
    if (!(length > 0)) continue;
    for (const std::uint32_t v : corners)
      vertices_[v].quadric.addPlane(across / length, length / 6);
  }
  for (std::size_t v = 0; v < normals_.size(); ++v) normals_[v] *= vertices_[v].quadric.weight;
}

void BatchSimplifier::collapseStars(const CancelFlag* cancel) {
  for (std::uint32_t t = 0; t < table_.triangles(); ++t) {
    if (cancel != nullptr && t % kBetweenLooks == 0) cancel->check();
    for (std::uint32_t c = CornerTable::firstCorner(t), end = c + 3; c < end && table_.isAlive(t);
         ++c) {
      Vertex& center = vertices_[table_.vertex(c)];
      if (center.was_tried || center.is_fixed || touched_[table_.vertex(c)] == round_) continue;
      center.was_tried = true;
      collapseStar(c);
    }
  }
}

void BatchSimplifier::collapseStar(std::uint32_t corner) {
  if (!region_.findStar(table_, corner)) return;
  const std::span inner =
      std::span(region_.vertices)
          .subspan(CollapseRegion::kFirstInner, static_cast<std::size_t>(region_.inner));
  for (const std::uint32_t v : inner)
    if (vertices_[v].is_fixed || touched_[v] == round_) return;
  Vertex& center = vertices_[inner[0]];
  Quadric sum;
  glm::vec3 mean(0.0f);
  for (const std::uint32_t v : inner) {
    const glm::vec3 to = vertices_[v].position - center.position;
    Quadric quadric = vertices_[v].quadric;
    quadric.moveCenter(-to);
    sum += quadric;
    mean += to / static_cast<float>(inner.size());
  }
  const glm::vec3 best = sum.leastNear(mean, kPull * sum.weight);
  if (!(sum.valueAt(best) <= kMostMeanSquareOfStar * distance_ * distance_ * sum.weight)) return;
  glm::vec3 voxels = voxelsOf(center.position + best);
  if (!keepInCapPlanes(inner, voxels)) return;
  const glm::vec3 place = positionOf(voxels);
  if (!region_.findAroundStar(table_) || !mayCollapse(place)) return;
  for (const std::uint32_t arm : inner.subspan(1)) {
    normals_[inner[0]] += normals_[arm];
    touched_[arm] = round_;
  }
  sum.moveCenter(place - center.position);
  center.quadric = sum;
  collapseRegion(inner[0], voxels);
}

void BatchSimplifier::collapseEdges(const CancelFlag* cancel, const MeshBatch& batch) {
  for (;;) {
    ++round_;
    if (cancel != nullptr) cancel->check();
    addCandidates();
    if (candidates_.empty()) break;
    sortCandidates();
    collapseCheapest(cancel, batch);
    keepUntouched();
  }
}

void BatchSimplifier::findEdges(const std::vector<std::uint8_t>* marks) {
  candidates_.clear();
  to_cost_.clear();
  for (std::uint32_t t = 0; t < table_.triangles(); ++t) {
    if (!table_.isAlive(t)) continue;
    for (std::uint32_t c = CornerTable::firstCorner(t), end = c + 3; c < end; ++c)
      if (c < table_.opposite(c) &&
          (marks == nullptr || (*marks)[table_.vertex(CornerTable::next(c))] != 0 ||
           (*marks)[table_.vertex(CornerTable::previous(c))] != 0))
        costAgain(c);
  }
}

std::uint32_t BatchSimplifier::cornerThatGoes(std::uint32_t corner) const {
  const Vertex& first = vertices_[table_.vertex(corner)];
  const Vertex& second = vertices_[table_.vertex(CornerTable::next(corner))];
  if (first.is_broken || second.is_broken) return kNone;
  if (!first.is_fixed) return corner;
  if (second.is_fixed) return kNone;
  return CornerTable::next(table_.opposite(CornerTable::previous(corner)));
}

// Adds the edges that have no cost yet.
void BatchSimplifier::addCandidates() {
  const float most = kMostMeanSquare * distance_ * distance_;
  std::array<Candidate, EdgeBlock::kEdges> edges;
  std::size_t count = 0;
  const auto evaluate = [&] {
    edges_.compute();
    for (std::size_t i = 0; i < count; ++i)
      if (edges_.cost(i) <= most * edges_.weight(i)) {
        edges[i].cost = edges_.cost(i);
        candidates_.push_back(edges[i]);
      }
    count = 0;
  };
  for (const std::uint32_t c : to_cost_) {
    table_.mark(c, CornerTable::Mark::kWaits, false);
    if (!table_.isAlive(CornerTable::triangleOf(c))) continue;
    const std::uint32_t facing = table_.opposite(c);
    if (facing == kNone || table_.isMarked(facing, CornerTable::Mark::kWaits)) continue;
    const std::uint32_t corner = cornerThatGoes(CornerTable::next(c));
    if (corner == kNone) continue;
    Candidate& edge = edges[count];
    edge = {0, table_.vertex(corner), table_.vertex(CornerTable::next(corner)), corner};
    const Vertex &gone = vertices_[edge.gone], &kept = vertices_[edge.kept];
    edges_.set(count++, gone.quadric, kept.quadric, gone.position - kept.position, kept.is_fixed);
    if (count == EdgeBlock::kEdges) evaluate();
  }
  evaluate();
  to_cost_.clear();
}

// Roughly in order: by the highest bits of their costs.
void BatchSimplifier::sortCandidates() {
  constexpr int kBits = 12;
  std::array<std::uint32_t, (1u << kBits) + 1> first{};
  const auto keyOf = [](const Candidate& candidate) {
    return std::bit_cast<std::uint32_t>(candidate.cost) >> (31 - kBits);
  };
  for (const Candidate& candidate : candidates_) ++first[keyOf(candidate) + 1];
  for (std::size_t i = 1; i < first.size(); ++i) first[i] += first[i - 1];
  sorted_.resize(candidates_.size());
  for (const Candidate& candidate : candidates_) sorted_[first[keyOf(candidate)]++] = candidate;
  candidates_.swap(sorted_);
}

void BatchSimplifier::collapseCheapest(const CancelFlag* cancel, const MeshBatch& batch) {
  std::size_t turns = candidates_.size();
  if (turns > kFewCandidates) turns /= kCandidatesForEach;
  for (std::size_t i = 0; i < turns; ++i) {
    if (cancel != nullptr && i % kBetweenLooks == 0) cancel->check();
    const std::uint32_t corner = candidates_[i].corner;
    if (!isUntouched(candidates_[i]) || collapseEdge(corner, batch)) continue;
    const std::uint32_t facing = CornerTable::previous(corner);
    table_.mark(std::min(facing, table_.opposite(facing)), CornerTable::Mark::kFailed, true);
  }
  candidates_.erase(candidates_.begin(), candidates_.begin() + static_cast<std::ptrdiff_t>(turns));
}

// Edges at vertices that this round changed have no cost that counts.
void BatchSimplifier::keepUntouched() {
  std::erase_if(candidates_, [&](const Candidate& candidate) { return !isUntouched(candidate); });
}

bool BatchSimplifier::collapseEdge(std::uint32_t corner, const MeshBatch& batch) {
  const std::uint32_t gone_vertex = table_.vertex(corner);
  const std::uint32_t kept_vertex = table_.vertex(CornerTable::next(corner));
  const Vertex& gone = vertices_[gone_vertex];
  Vertex& kept = vertices_[kept_vertex];
  const glm::vec3 to_gone = gone.position - kept.position;
  Quadric quadric = gone.quadric;
  quadric.moveCenter(-to_gone);
  quadric += kept.quadric;
  glm::vec3 voxels =
      kept.is_fixed ? voxels_[kept_vertex] : voxelsOf(kept.position + bestPlace(quadric, to_gone));
  const std::array joined = {gone_vertex, kept_vertex};
  if (!keepInCapPlanes(joined, voxels) || (kept.is_fixed && voxels != voxels_[kept_vertex]))
    return false;
  const glm::vec3 place = positionOf(voxels);
  if (!region_.findEdge(table_, corner, kept.is_fixed)) return false;
  if (kept.is_fixed && !keepsOthersApart(corner, batch)) return false;
  if (!mayCollapse(place)) return false;
  touched_[gone_vertex] = round_;
  if (!kept.is_fixed) normals_[kept_vertex] += normals_[gone_vertex];
  quadric.moveCenter(place - kept.position);
  kept.quadric = quadric;
  collapseRegion(kept_vertex, voxels);
  costAgainAround();
  return true;
}

// The costs of all edges at the vertex have changed; those around it may be tried once more.
void BatchSimplifier::costAgainAround() {
  const auto corners = std::span(region_.corners).first(static_cast<std::size_t>(region_.sides()));
  for (const std::uint32_t at : corners) {
    const std::uint32_t across = std::min(at, table_.opposite(at));
    if (table_.isMarked(across, CornerTable::Mark::kFailed)) costAgain(across);
    costAgain(CornerTable::next(at));
    costAgain(CornerTable::previous(at));
  }
  if (!region_.is_open) return;
  std::uint32_t at = table_.left(corners.back());
  for (; at != kNone && at != corners.front(); at = table_.left(at))
    costAgain(CornerTable::previous(at));
  if (at != kNone) return;
  for (at = table_.right(corners.front()); at != kNone; at = table_.right(at))
    costAgain(CornerTable::next(at));
}

void BatchSimplifier::costAgain(std::uint32_t facing) {
  const std::uint32_t edge = std::min(facing, table_.opposite(facing));
  table_.mark(edge, CornerTable::Mark::kFailed, false);
  if (table_.isMarked(edge, CornerTable::Mark::kWaits)) return;
  table_.mark(edge, CornerTable::Mark::kWaits, true);
  to_cost_.push_back(edge);
}

bool BatchSimplifier::mayCollapse(const glm::vec3& place) {
  const auto set = [&](int point) {
    region_.setPlace(point, vertices_[region_.vertices[point]].position - place);
  };
  for (int i = 0; i < region_.ring; ++i) set(i);
  for (int i = 0; i < region_.inner; ++i) set(CollapseRegion::kFirstInner + i);
  int narrowings = 0;
  for (int i = 0; i < region_.inner; ++i)
    narrowings =
        std::max<int>(narrowings, narrowings_[region_.vertices[CollapseRegion::kFirstInner + i]]);
  return bound_.follow(region_, deviations_, std::ldexp(distance_, -2 * narrowings));
}

void BatchSimplifier::collapseRegion(std::uint32_t vertex, const glm::vec3& voxels) {
  for (int i = 0; i < region_.inner && !cap_planes_.empty(); ++i)
    cap_planes_[vertex] |= cap_planes_[region_.vertices[CollapseRegion::kFirstInner + i]];
  region_.replace(table_, vertex);
  voxels_[vertex] = voxels;
  vertices_[vertex].position = positionOf(voxels);
  touched_[vertex] = round_;
  for (int i = 0; i < region_.sides(); ++i)
    deviations_[CornerTable::triangleOf(region_.corners[i])] = bound_.deviation(i);
}

glm::vec3 BatchSimplifier::voxelsOf(const glm::vec3& position) const {
  const glm::vec3 voxels = space_.to_voxels * position + center_;
  return glm::clamp(glm::floor(voxels * grid_steps_ + 0.5f) / grid_steps_, lower_, upper_);
}

// Other bricks may have a side of a uniform brick only if both its vertices lie in one face of the
// brick; leaves of other levels may have any side.
bool BatchSimplifier::mayBeElsewhere(const MeshBatch& batch, std::uint32_t a,
                                     std::uint32_t b) const {
  if (!vertices_[a].is_shared || !vertices_[b].is_shared) return false;
  return !batch.is_uniform || (sidesOf(batch.positions[a], lower_, upper_) &
                               sidesOf(batch.positions[b], lower_, upper_)) != 0;
}

// Around a fixed vertex: none of its new sides is there already, no new triangle comes back to back
// with another, and neither might be there in another batch.
bool BatchSimplifier::keepsOthersApart(std::uint32_t corner, const MeshBatch& batch) const {
  const std::uint32_t at_kept = CornerTable::next(corner);
  const std::uint32_t kept = table_.vertex(at_kept);
  const std::span new_neighbours =
      std::span(region_.vertices).subspan(1, static_cast<std::size_t>(region_.ring) - 2);
  if (new_neighbours.empty()) {
    const std::uint32_t facing = table_.opposite(table_.left(corner));
    if (facing != kNone) return table_.vertex(facing) != kept;
    return !(mayBeElsewhere(batch, kept, region_.vertices[0]) &&
             mayBeElsewhere(batch, kept, region_.vertices[1]) &&
             mayBeElsewhere(batch, region_.vertices[0], region_.vertices[1]));
  }
  const auto isNew = [&](std::uint32_t vertex) {
    return std::ranges::find(new_neighbours, vertex) == new_neighbours.end();
  };
  const std::uint32_t other = CornerTable::next(table_.opposite(CornerTable::previous(corner)));
  for (std::uint32_t at = table_.right(at_kept); at != kNone && at != other; at = table_.right(at))
    if (!isNew(table_.vertex(CornerTable::next(at)))) return false;
  for (std::uint32_t at = table_.left(other); at != kNone && at != at_kept; at = table_.left(at))
    if (!isNew(table_.vertex(CornerTable::previous(at)))) return false;
  return std::ranges::none_of(
      new_neighbours, [&](std::uint32_t vertex) { return mayBeElsewhere(batch, kept, vertex); });
}

bool BatchSimplifier::collapseBorders(const CancelFlag* cancel, const MeshBatch& batch,
                                      float most_shift) {
  ++round_;
  bool has_changed = false;
  for (std::uint32_t t = 0; t < table_.triangles(); ++t) {
    if (cancel != nullptr && t % kBetweenLooks == 0) cancel->check();
    for (std::uint32_t c = CornerTable::firstCorner(t), end = c + 3; c < end && table_.isAlive(t);
         ++c)
      if (vertices_[table_.vertex(c)].is_border && table_.right(c) == kNone)
        has_changed = collapseBorder(c, batch, most_shift) || has_changed;
  }
  return has_changed;
}

unsigned BatchSimplifier::bordersOf(const MeshBatch& batch, std::uint32_t vertex) const {
  return sidesOf(batch.positions[vertex], glm::vec3(-batch.origin),
                 glm::vec3(space_.voxels - Index3(1) - batch.origin));
}

// The vertex is moved to the line between its neighbours, which carries all points of its triangles
// along by a part of that way; then the region is the same with it and without it.
bool BatchSimplifier::collapseBorder(std::uint32_t corner, const MeshBatch& batch,
                                     float most_shift) {
  std::uint32_t last = corner;
  while (table_.left(last) != kNone) last = table_.left(last);
  if (last == corner) return false;
  const std::uint32_t gone = table_.vertex(corner),
                      first = table_.vertex(CornerTable::next(corner)),
                      other = table_.vertex(CornerTable::previous(last));
  if (first == other || vertices_[first].is_broken || vertices_[other].is_broken) return false;
  if ((bordersOf(batch, gone) & bordersOf(batch, first) & bordersOf(batch, other)) == 0)
    return false;
  const glm::vec3 &from = vertices_[first].position, &at = vertices_[gone].position;
  const glm::vec3 along = vertices_[other].position - from;
  const float part = glm::dot(at - from, along) / glm::dot(along, along);
  if (!(part > 0 && part < 1)) return false;
  const glm::vec3 place = from + part * along;
  region_.shift = place - at;
  if (!(glm::dot(region_.shift, region_.shift) <= most_shift * most_shift)) return false;
  return becomesNeighbour(corner, batch, part <= 0.5f, place) ||
         becomesNeighbour(corner, batch, part > 0.5f, place);
}

bool BatchSimplifier::becomesNeighbour(std::uint32_t corner, const MeshBatch& batch, bool first,
                                       const glm::vec3& place) {
  constexpr int kGone = CollapseRegion::kFirstInner, kKept = kGone + 1;
  if (!region_.findBorder(table_, corner, first) || !keepsBordersApart(batch)) return false;
  const std::uint32_t gone_vertex = region_.vertices[kGone], kept_vertex = region_.vertices[kKept];
  if (!cap_planes_.empty() && (cap_planes_[gone_vertex] & ~cap_planes_[kept_vertex]) != 0)
    return false;
  Vertex &gone = vertices_[gone_vertex], &kept = vertices_[kept_vertex];
  const glm::vec3 was = std::exchange(gone.position, place);
  const bool may_collapse = mayCollapse(kept.position);
  gone.position = was;
  if (!may_collapse) return false;
  Quadric quadric = gone.quadric;
  quadric.moveCenter(kept.position - gone.position);
  kept.quadric += quadric;
  touched_[gone_vertex] = round_;
  collapseRegion(kept_vertex, voxels_[kept_vertex]);
  costAgainAround();
  return true;
}

// At the border: the vertex that stays has none of its new neighbours yet, here or in another
// batch.
bool BatchSimplifier::keepsBordersApart(const MeshBatch& batch) const {
  const std::uint32_t kept = region_.vertices[CollapseRegion::kFirstInner + 1];
  const bool is_first = region_.border_point != 0;
  const std::span new_neighbours =
      std::span(region_.vertices)
          .subspan(is_first ? 1 : 0, static_cast<std::size_t>(region_.ring) - 1);
  const auto isNew = [&](std::uint32_t vertex) {
    return std::ranges::find(new_neighbours, vertex) != new_neighbours.end();
  };
  // Its triangles on either side of the one that vanishes.
  const std::uint32_t vanishing = region_.corners[region_.triangles - 1];
  const std::uint32_t at_kept =
      is_first ? CornerTable::next(vanishing) : CornerTable::previous(vanishing);
  for (std::uint32_t at = table_.right(at_kept); at != kNone && at != at_kept;
       at = table_.right(at))
    if (isNew(table_.vertex(CornerTable::next(at)))) return false;
  for (std::uint32_t at = table_.left(at_kept); at != kNone && at != at_kept; at = table_.left(at))
    if (isNew(table_.vertex(CornerTable::previous(at)))) return false;
  return std::ranges::none_of(
      new_neighbours, [&](std::uint32_t vertex) { return mayBeElsewhere(batch, kept, vertex); });
}

bool BatchSimplifier::narrowAroundCrossings(const MeshBatch& batch, float reach) {
  left_.clear();
  for (std::uint32_t t = 0; t < table_.triangles(); ++t)
    if (const std::uint32_t c = CornerTable::firstCorner(t); table_.isAlive(t))
      left_.push_back({table_.vertex(c), table_.vertex(c + 1), table_.vertex(c + 2)});
  grid_positions_.resize(voxels_.size());
  std::ranges::transform(voxels_, grid_positions_.begin(),
                         [this](const glm::vec3& voxels) { return onGrid(voxels); });
  next_narrowings_ = narrowings_;
  for (const std::uint32_t t : crossings_.find(grid_positions_, left_)) {
    glm::vec3 lower = vertices_[left_[t][0]].position, upper = lower;
    for (const std::uint32_t v : left_[t]) {
      lower = glm::min(lower, vertices_[v].position - reach);
      upper = glm::max(upper, vertices_[v].position + reach);
    }
    for (std::uint32_t v = 0; v < narrowings_.size(); ++v) {
      if ((vertices_[v].is_fixed && !vertices_[v].is_border) ||
          next_narrowings_[v] > narrowings_[v])
        continue;
      const glm::vec3 was = positionOf(batch.positions[v]);
      if (glm::clamp(was, lower, upper) == was) ++next_narrowings_[v];
    }
  }
  narrowings_.swap(next_narrowings_);
  return narrowings_ != next_narrowings_;
}

void BatchSimplifier::write(MeshBatch& batch) {
  const auto first_cap = table_.triangles() - static_cast<std::uint32_t>(batch.cap_indices / 3);
  std::size_t corners = 0, before_caps = 0;
  for (std::uint32_t t = 0; t < table_.triangles(); ++t) {
    if (t == first_cap) before_caps = corners;
    for (std::uint32_t c = CornerTable::firstCorner(t), end = c + 3; c < end && table_.isAlive(t);
         ++c)
      batch.triangles[corners++] = table_.vertex(c);
  }
  batch.triangles.resize(corners);
  if (batch.cap_indices > 0) batch.cap_indices = corners - before_caps;
  for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
    if (touched_[v] == 0 || vertices_[v].is_fixed) continue;
    batch.positions[v] = voxels_[v];
    const float length = std::sqrt(glm::dot(normals_[v], normals_[v]));
    if (length > 0) batch.normals[v] = normals_[v] / length;
  }
  dropUnusedVertices(batch, numbers_);
  batch.transition_indices = 0;
}

void BatchSimplifier::writeRemains(SimplifyRemains& remains) const {
  remains.vertices.clear();
  for (std::size_t v = 0; v < vertices_.size(); ++v)
    if (numbers_[v] != kDroppedVertex)
      remains.vertices.push_back({vertices_[v].quadric, normals_[v]});
  remains.triangles.clear();
  for (std::uint32_t t = 0; t < table_.triangles(); ++t)
    if (table_.isAlive(t)) remains.triangles.push_back(deviations_[t]);
}

void BatchSimplifier::takeRemains(const SimplifyRemains& remains) {
  for (std::size_t v = 0; v < vertices_.size(); ++v) {
    vertices_[v].quadric = remains.vertices[v].quadric;
    normals_[v] = remains.vertices[v].normal_sum;
  }
  deviations_.assign(remains.triangles.begin(), remains.triangles.end());
}

}  // namespace isobrick
