#include "isobrick/extract/simplify/batch_simplifier.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec4.hpp>

namespace isobrick {
namespace {

// Trials, each with more triangles that stay. A different target would make faults at other places,
// so it is lowered only if these do not end.
constexpr int kMostTrials = 24, kTrialsOfOneTarget = 12;
// What meshoptimizer is asked for, as a part of the distance: its error is a mean of squares, and
// moving the vertices takes away about half of it.
constexpr float kTargetPart = 0.6f;
// Steps of the fit; after four it gains nothing more.
constexpr int kFitSteps = 4;

// Of the point of the triangle's plane below `point`, moved into the triangle.
glm::vec3 weightsOf(const glm::vec3& point, const SurfacePatch::Facet& facet) {
  const auto& [a, b, c] = facet.corners;
  const glm::vec3 ab = b - a, ac = c - a, ap = point - a;
  const float d00 = glm::dot(ab, ab), d01 = glm::dot(ab, ac), d11 = glm::dot(ac, ac);
  const float d20 = glm::dot(ap, ab), d21 = glm::dot(ap, ac);
  const float area = d00 * d11 - d01 * d01;
  if (!(area > 0)) return {1.0f, 0.0f, 0.0f};
  const float v = (d11 * d20 - d01 * d21) / area, w = (d00 * d21 - d01 * d20) / area;
  glm::vec3 weights = glm::max(glm::vec3(1 - v - w, v, w), glm::vec3(0.0f));
  return weights / (weights.x + weights.y + weights.z);
}

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
  if (batch.triangles.empty()) return;
  lower_ = upper_ = batch.positions[0];
  for (const glm::vec3& position : batch.positions) {
    lower_ = glm::min(lower_, position);
    upper_ = glm::max(upper_, position);
  }
  finest_positions_.resize(batch.positions.size());
  for (std::size_t v = 0; v < batch.positions.size(); ++v)
    finest_positions_[v] = glm::vec3(space.to_space * glm::dvec3(batch.positions[v]));
  finest_.set(batch.triangles, batch.positions.size());
  finest_.place(finest_positions_);
  stays_.assign(finest_.count(), 0);
  // An isosurface has none; if it had, they would be left as they are.
  for (const std::uint32_t vertex : finest_.faults()) keepAround(vertex);
  float target = kTargetPart * space.distance;
  for (int trial = 0; trial < kMostTrials; ++trial) {
    if (cancel != nullptr) cancel->check();
    if (simplifyOnce(space, target, batch)) {
      write(batch);
      return;
    }
    if (trial % kTrialsOfOneTarget == kTrialsOfOneTarget - 1) target /= 4;
  }
}

bool BatchSimplifier::simplifyOnce(const SimplifySpace& space, float target,
                                   const MeshBatch& batch) {
  refused_.clear();
  collapse(target);
  simplified_.set(result_, finest_positions_.size());
  if (!refuseFaults(batch)) return false;
  voxels_.assign(batch.positions.begin(), batch.positions.end());
  positions_ = finest_positions_;
  simplified_.place(positions_);
  findPlaces();
  fitVertices();
  settleVertices(space);
  return proveDistances(space.distance);
}

void BatchSimplifier::collapse(float target) {
  indices_.clear();
  result_.clear();
  for (std::uint32_t t = 0; t < finest_.count(); ++t) {
    const std::uint32_t* const corners = finest_.triangle(t);
    std::vector<std::uint32_t>& to = stays_[t] != 0 ? result_ : indices_;
    to.insert(to.end(), corners, corners + 3);
  }
  const std::size_t kept = result_.size();
  kept_ = static_cast<std::uint32_t>(kept / 3);
  if (indices_.empty()) return;
  result_.resize(kept + indices_.size());
  const float* const positions = &finest_positions_[0].x;
  // Its errors are parts of the extent of the positions.
  const float scale = meshopt_simplifyScale(positions, finest_positions_.size(), sizeof(glm::vec3));
  const std::size_t count = meshopt_simplify(
      &result_[kept], indices_.data(), indices_.size(), positions, finest_positions_.size(),
      sizeof(glm::vec3), 0, target / scale, meshopt_SimplifyLockBorder, nullptr);
  result_.resize(kept + count);
}

void BatchSimplifier::keepAround(std::uint32_t vertex) {
  for (const std::uint32_t t : finest_.around(vertex)) stays_[t] = 1;
}

// Besides faults of the patch alone: a side between two vertices that another batch has as well,
// and that was none before, could be a side there too, and so could a triangle between three of
// them. Of a uniform brick, others have both vertices only if they lie in one of its sides; leaves
// of other levels may have any two.
bool BatchSimplifier::refuseFaults(const MeshBatch& batch) {
  is_fixed_.assign(finest_positions_.size(), 0);
  for (const MeshBatch::SharedVertex& shared : batch.shared) is_fixed_[shared.vertex] = 2;
  refused_.insert(refused_.end(), simplified_.faults().begin(), simplified_.faults().end());
  const auto mayBeElsewhere = [&](std::uint32_t a, std::uint32_t b) {
    if (is_fixed_[a] != 2 || is_fixed_[b] != 2) return false;
    return !batch.is_uniform || (sidesOf(batch.positions[a], lower_, upper_) &
                                 sidesOf(batch.positions[b], lower_, upper_)) != 0;
  };
  const auto corner = [this](std::uint32_t t, int c) { return simplified_.triangle(t)[c % 3]; };
  for (std::uint32_t t = kept_; t < simplified_.count(); ++t) {
    int sides = 0;
    for (int side = 0; side < 3; ++side) {
      const std::uint32_t from = corner(t, side), to = corner(t, side + 1);
      if (!mayBeElsewhere(from, to)) continue;
      ++sides;
      if (simplified_.beside(t, side) != SurfacePatch::kNone && !finest_.hasSide(from, to))
        refused_.insert(refused_.end(), {from, to});
    }
    if (sides == 3 && !finest_.hasTriangle(simplified_.triangle(t)))
      refused_.insert(refused_.end(), {corner(t, 0), corner(t, 1), corner(t, 2)});
  }
  for (std::uint32_t t = 0; t < simplified_.count(); ++t)
    for (int side = 0; side < 3; ++side)
      if (simplified_.beside(t, side) == SurfacePatch::kNone)
        for (const int c : {side, side == 2 ? 0 : side + 1})
          is_fixed_[simplified_.triangle(t)[c]] |= 1;
  for (std::uint32_t t = 0; t < finest_.count(); ++t)
    if (stays_[t] != 0)
      for (int c = 0; c < 3; ++c) is_fixed_[finest_.triangle(t)[c]] |= 1;
  for (const std::uint32_t vertex : refused_) keepAround(vertex);
  return refused_.empty();
}

// Where finest vertices lie on the simplified patch: those that remain at themselves, the others by
// walking from a vertex that they share a triangle with, so that nobody comes to another sheet.
void BatchSimplifier::findPlaces() {
  places_.assign(finest_positions_.size(), Place());
  waiting_.clear();
  for (std::uint32_t v = 0; v < places_.size(); ++v)
    if (!simplified_.around(v).empty()) {
      places_[v].triangle = simplified_.around(v)[0];
      waiting_.push_back(v);
    }
  for (std::size_t next = 0; next < waiting_.size(); ++next) {
    const std::uint32_t from = waiting_[next];
    for (const std::uint32_t t : finest_.around(from))
      for (int c = 0; c < 3; ++c) {
        const std::uint32_t v = finest_.triangle(t)[c];
        Place& place = places_[v];
        if (place.triangle != SurfacePatch::kNone) continue;
        place.triangle = walkTo(simplified_, finest_positions_[v], places_[from].triangle);
        place.weights = weightsOf(finest_positions_[v], simplified_.facet(place.triangle));
        waiting_.push_back(v);
      }
  }
}

// Least squares of the heights of finest vertices over their triangles, by simultaneous steps: each
// vertex goes the weighted mean of what is left around it.
void BatchSimplifier::fitVertices() {
  const auto patch = simplified_.triangles();
  for (int step = 0; step < kFitSteps; ++step) {
    shifts_.assign(positions_.size(), glm::vec4(0.0f));
    for (std::uint32_t v = 0; v < places_.size(); ++v) {
      const Place& place = places_[v];
      if (place.triangle == SurfacePatch::kNone || !simplified_.around(v).empty()) continue;
      const std::uint32_t* const corners = &patch[std::size_t{3} * place.triangle];
      glm::vec3 at(0.0f);
      for (int c = 0; c < 3; ++c) at += place.weights[c] * positions_[corners[c]];
      const glm::vec3& normal = simplified_.facet(place.triangle).normal;
      const glm::vec3 left = glm::dot(finest_positions_[v] - at, normal) * normal;
      for (int c = 0; c < 3; ++c)
        shifts_[corners[c]] += glm::vec4(place.weights[c] * left, place.weights[c]);
    }
    for (std::uint32_t v = 0; v < positions_.size(); ++v) {
      if (is_fixed_[v] != 0 || !(shifts_[v].w > 0)) continue;
      // The vertex itself counts as one that lies where it was.
      const glm::vec3 own = finest_positions_[v] - positions_[v];
      positions_[v] += (glm::vec3(shifts_[v]) + own) / (shifts_[v].w + 1);
    }
  }
}

// Before the proof, so that it is about what is written: a vertex stays in the box of its batch.
// One that was not moved keeps its bits.
void BatchSimplifier::settleVertices(const SimplifySpace& space) {
  for (std::uint32_t v = 0; v < positions_.size(); ++v) {
    if (positions_[v] == finest_positions_[v]) continue;
    voxels_[v] = glm::clamp(glm::vec3(space.to_voxels * glm::dvec3(positions_[v])), lower_, upper_);
    positions_[v] = glm::vec3(space.to_space * glm::dvec3(voxels_[v]));
  }
  simplified_.place(positions_);
}

// A walk may end beside the triangle that it looks for, so it is tried from each corner.
bool BatchSimplifier::proveDistances(float distance) {
  const auto prove = [&](const SurfacePatch& of, std::uint32_t t, const SurfacePatch& against,
                         const auto& startAt) {
    const std::array<glm::vec3, 3>& corners = of.facet(t).corners;
    const glm::vec3 center = (corners[0] + corners[1] + corners[2]) / 3.0f;
    for (int c = 0; c < 3; ++c) {
      const std::uint32_t start = startAt(of.triangle(t)[c]);
      if (start != SurfacePatch::kNone &&
          proof_.isWithin(against, corners, walkTo(against, center, start), distance))
        return;
    }
    refused_.insert(refused_.end(), of.triangle(t), of.triangle(t) + 3);
  };
  for (std::uint32_t t = 0; t < finest_.count(); ++t)
    if (stays_[t] == 0)
      prove(finest_, t, simplified_, [&](std::uint32_t v) { return places_[v].triangle; });
  for (std::uint32_t t = kept_; t < simplified_.count(); ++t)
    prove(simplified_, t, finest_, [&](std::uint32_t v) { return finest_.around(v)[0]; });
  // Without area there is no normal, and nothing but a line to draw.
  for (std::uint32_t t = kept_; t < simplified_.count(); ++t)
    if (simplified_.facet(t).normal == glm::vec3(0.0f))
      refused_.insert(refused_.end(), simplified_.triangle(t), simplified_.triangle(t) + 3);
  for (const std::uint32_t vertex : refused_) keepAround(vertex);
  return refused_.empty();
}

void BatchSimplifier::write(MeshBatch& batch) const {
  std::vector<std::uint32_t> numbers(batch.positions.size(), SurfacePatch::kNone);
  std::uint32_t count = 0;
  for (std::uint32_t v = 0; v < numbers.size(); ++v) {
    if (simplified_.around(v).empty()) continue;
    numbers[v] = count;
    batch.positions[count] = voxels_[v];
    batch.normals[count] = batch.normals[v];
    ++count;
  }
  batch.positions.resize(count);
  batch.normals.resize(count);
  std::erase_if(batch.shared,
                [&](const auto& s) { return numbers[s.vertex] == SurfacePatch::kNone; });
  for (MeshBatch::SharedVertex& shared : batch.shared) shared.vertex = numbers[shared.vertex];
  batch.triangles.resize(simplified_.triangles().size());
  for (std::size_t i = 0; i < batch.triangles.size(); ++i)
    batch.triangles[i] = numbers[simplified_.triangles()[i]];
  batch.transition_indices = 0;
}

}  // namespace isobrick
