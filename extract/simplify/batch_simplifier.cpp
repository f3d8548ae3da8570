#include "isobrick/extract/simplify/batch_simplifier.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "isobrick/extract/sinks/batch_components.h"

namespace isobrick {
namespace {

// The cheapest of so many candidates get their turn in a round; if there are few, all do.
constexpr std::size_t kCandidatesForEach = 2, kFewCandidates = 256;
// An edge is not tried if its triangles would lie further from the finest ones than this part of
// the distance, in the mean of squares: it would hardly ever be let through.
constexpr float kMostMeanSquare = 0.05f;
constexpr std::uint32_t kNone = CornerTable::kNone;

// Sides of the batch's box that a vertex lies in: two bits an axis.
unsigned sidesOf(const glm::vec3& position, const glm::vec3& lower, const glm::vec3& upper) {
  unsigned sides = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (position[axis] == lower[axis]) sides |= 1u << (2 * axis);
    if (position[axis] == upper[axis]) sides |= 2u << (2 * axis);
  }
  return sides;
}

}  // namespace

void BatchSimplifier::simplify(const SimplifySpace& space, const CancelFlag* cancel,
                               MeshBatch& batch) {
  if (space.drops_small) small_.drop(space.to_space, space.distance, batch);
  if (batch.triangles.empty()) return;
  begin(space, batch);
  addPlanes();
  for (round_ = 1;; ++round_) {
    if (cancel != nullptr) cancel->check();
    findCandidates();
    if (candidates_.empty()) break;
    sortCandidates();
    collapseCandidates(cancel, batch);
  }
  write(batch);
}

void BatchSimplifier::begin(const SimplifySpace& space, const MeshBatch& batch) {
  space_ = space;
  lower_ = upper_ = batch.positions[0];
  for (const glm::vec3& position : batch.positions) {
    lower_ = glm::min(lower_, position);
    upper_ = glm::max(upper_, position);
  }
  center_ = glm::round((lower_ + upper_) / 2.0f);
  table_.set(batch.triangles, batch.positions.size());
  vertices_.assign(batch.positions.size(), Vertex());
  for (const MeshBatch::SharedVertex& shared : batch.shared)
    vertices_[shared.vertex].is_shared = true;
  for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
    Vertex& vertex = vertices_[v];
    vertex.position = space_.to_space * (batch.positions[v] - center_);
    vertex.is_fixed = vertex.is_shared || table_.ring(v) != CornerTable::Ring::kClosed;
    vertex.is_broken = table_.ring(v) == CornerTable::Ring::kBroken;
  }
  normals_.assign(batch.normals.begin(), batch.normals.end());
  deviations_.assign(table_.triangles(), Deviation());
  alive_.resize(table_.triangles());
  for (std::uint32_t t = 0; t < table_.triangles(); ++t) alive_[t] = t;
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

std::uint32_t BatchSimplifier::cornerThatGoes(std::uint32_t corner) const {
  const Vertex& first = vertices_[table_.vertex(corner)];
  const Vertex& second = vertices_[table_.vertex(CornerTable::next(corner))];
  if (first.is_broken || second.is_broken) return kNone;
  if (!first.is_fixed) return corner;
  if (second.is_fixed) return kNone;
  return CornerTable::next(table_.opposite(CornerTable::previous(corner)));
}

void BatchSimplifier::findCandidates() {
  candidates_.clear();
  std::erase_if(alive_, [&](std::uint32_t t) { return !table_.isAlive(t); });
  const float most = kMostMeanSquare * space_.distance * space_.distance;
  std::array<std::uint32_t, EdgeBlock::kEdges> corners;
  std::size_t count = 0;
  const auto evaluate = [&] {
    edges_.compute();
    for (std::size_t i = 0; i < count; ++i)
      if (edges_.cost(i) <= most * edges_.weight(i))
        candidates_.push_back({edges_.cost(i), corners[i]});
    count = 0;
  };
  for (const std::uint32_t t : alive_)
    for (std::uint32_t c = CornerTable::firstCorner(t), end = c + 3; c < end; ++c) {
      const std::uint32_t facing = table_.opposite(c);
      if (facing == kNone || facing < c || table_.isMarked(c)) continue;
      const std::uint32_t corner = cornerThatGoes(CornerTable::next(c));
      if (corner == kNone) continue;
      const Vertex& gone = vertices_[table_.vertex(corner)];
      const Vertex& kept = vertices_[table_.vertex(CornerTable::next(corner))];
      edges_.set(count, gone.quadric, kept.quadric, gone.position - kept.position, kept.is_fixed);
      corners[count++] = corner;
      if (count == EdgeBlock::kEdges) evaluate();
    }
  evaluate();
}

// The cheapest part of them, roughly in order: by the highest bits of their costs.
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
  if (sorted_.size() > kFewCandidates) sorted_.resize(sorted_.size() / kCandidatesForEach);
}

void BatchSimplifier::collapseCandidates(const CancelFlag* cancel, const MeshBatch& batch) {
  constexpr std::size_t kBetweenLooks = 1024;
  for (std::size_t i = 0; i < sorted_.size(); ++i) {
    if (cancel != nullptr && i % kBetweenLooks == 0) cancel->check();
    const std::uint32_t corner = sorted_[i].corner;
    if (!table_.isAlive(CornerTable::triangleOf(corner))) continue;
    if (vertices_[table_.vertex(corner)].touched == round_ ||
        vertices_[table_.vertex(CornerTable::next(corner))].touched == round_)
      continue;
    if (collapse(corner, batch)) continue;
    const std::uint32_t facing = CornerTable::previous(corner);
    table_.mark(std::min(facing, table_.opposite(facing)), true);
  }
}

glm::vec3 BatchSimplifier::voxelsOf(const glm::vec3& position) const {
  return glm::clamp(space_.to_voxels * position + center_, lower_, upper_);
}

bool BatchSimplifier::collapse(std::uint32_t corner, const MeshBatch& batch) {
  const std::uint32_t gone_vertex = table_.vertex(corner);
  const std::uint32_t kept_vertex = table_.vertex(CornerTable::next(corner));
  const Vertex& gone = vertices_[gone_vertex];
  Vertex& kept = vertices_[kept_vertex];
  const glm::vec3 to_gone = gone.position - kept.position;
  Quadric quadric = gone.quadric;
  quadric.moveCenter(-to_gone);
  quadric += kept.quadric;
  const glm::vec3 place =
      kept.is_fixed
          ? kept.position
          : space_.to_space * (voxelsOf(kept.position + bestPlace(quadric, to_gone)) - center_);
  if (!findRegion(corner, place)) return false;
  if (region_.is_open && !keepsOthersApart(corner, batch)) return false;
  if (!bound_.follow(region_, deviations_, space_.distance)) return false;
  table_.collapse(corner);
  quadric.moveCenter(place - kept.position);
  kept.quadric = quadric;
  kept.position = place;
  if (!kept.is_fixed) normals_[kept_vertex] += normals_[gone_vertex];
  kept.touched = round_;
  for (int i = 0; i < region_.sides(); ++i) {
    const std::uint32_t t = region_.old_triangles[i];
    deviations_[t] = bound_.deviation(i);
    for (std::uint32_t c = CornerTable::firstCorner(t), end = c + 3; c < end; ++c)
      table_.mark(std::min(c, table_.opposite(c)), false);
  }
  return true;
}

bool BatchSimplifier::findRegion(std::uint32_t corner, const glm::vec3& place) {
  const std::uint32_t at_kept = CornerTable::next(corner);
  const std::uint32_t beyond = table_.opposite(CornerTable::previous(corner));
  const std::uint32_t left = CornerTable::triangleOf(corner),
                      right = CornerTable::triangleOf(beyond);
  const Vertex& kept = vertices_[table_.vertex(at_kept)];
  region_.is_open = kept.is_fixed;
  region_.gone = vertices_[table_.vertex(corner)].position - place;
  region_.kept = kept.position - place;
  int count = 0;
  const auto add = [&](std::uint32_t at) {
    ring_[count] = table_.vertex(at);
    region_.ring[count] = vertices_[ring_[count]].position - place;
    ++count;
  };
  add(CornerTable::previous(corner));
  for (std::uint32_t at = table_.left(corner); CornerTable::triangleOf(at) != right;
       at = table_.left(at)) {
    if (count == CollapseRegion::kMostRing) return false;
    region_.old_triangles[count - 1] = CornerTable::triangleOf(at);
    add(CornerTable::previous(at));
  }
  region_.last_of_gone = count - 1;
  if (count < 2) return false;
  if (!region_.is_open) {
    std::uint32_t at = table_.left(CornerTable::next(beyond));
    if (CornerTable::triangleOf(at) == left) return false;
    for (;; add(CornerTable::previous(at)), at = table_.left(at)) {
      region_.old_triangles[count - 1] = CornerTable::triangleOf(at);
      if (CornerTable::triangleOf(table_.left(at)) == left) break;
      if (count == CollapseRegion::kMostRing) return false;
    }
    if (count < 3) return false;
  }
  region_.count = count;
  region_.old_triangles[region_.sides()] = left;
  region_.old_triangles[region_.sides() + 1] = right;
  return true;
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
      std::span(ring_).subspan(1, static_cast<std::size_t>(region_.last_of_gone) - 1);
  if (new_neighbours.empty()) {
    const std::uint32_t facing = table_.opposite(table_.left(corner));
    if (facing != kNone) return table_.vertex(facing) != kept;
    return !(mayBeElsewhere(batch, kept, ring_[0]) && mayBeElsewhere(batch, kept, ring_[1]) &&
             mayBeElsewhere(batch, ring_[0], ring_[1]));
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

void BatchSimplifier::write(MeshBatch& batch) {
  std::size_t corners = 0;
  for (const std::uint32_t t : alive_)
    for (std::uint32_t c = CornerTable::firstCorner(t), end = c + 3; c < end; ++c)
      batch.triangles[corners++] = table_.vertex(c);
  batch.triangles.resize(corners);
  for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
    if (vertices_[v].touched == 0 || vertices_[v].is_fixed) continue;
    batch.positions[v] = voxelsOf(vertices_[v].position);
    const float length = std::sqrt(glm::dot(normals_[v], normals_[v]));
    if (length > 0) batch.normals[v] = normals_[v] / length;
  }
  dropUnusedVertices(batch, numbers_);
  batch.transition_indices = 0;
}

}  // namespace isobrick
