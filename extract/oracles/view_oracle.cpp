#include "isobrick/extract/oracles/view_oracle.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/extract/oracles/coverage.h"

namespace isobrick {

ViewOracle::ViewOracle(const Lattice& lattice, const GridGeometry& geometry, const ViewPoint& view)
    : last_level_(lattice.levels() - 1),
      spacing_(geometry.spacing),
      eye_(geometry.worldToIndex(view.eye) * geometry.spacing),
      is_parallel_(view.pixels_per_unit.has_value()) {
  const double diagonal = glm::length(spacing_) * kDiagonalRoom;
  const double edge = std::max({spacing_.x, spacing_.y, spacing_.z});
  constexpr double kEverywhere = std::numeric_limits<double>::infinity();
  const double slope =
      std::max(view.pixels_per_radian * edge / view.pixels + 0.5 * diagonal, 1.5 * diagonal);
  for (int level = 0; level <= last_level_; ++level) {
    double within = slope * std::ldexp(1.0, level);
    if (is_parallel_)
      within = std::ldexp(edge, level) * *view.pixels_per_unit > view.pixels ? kEverywhere : 0.0;
    seen_within_squared_.push_back(level == 0 ? 0.0 : within * within);
    near_field_within_.push_back(refinedWithin(level, diagonal));
  }
  if (!view.field) return;
  has_field_ = true;
  direction_ = glm::normalize(glm::transpose(geometry.direction) * view.field->direction);
  field_sine_ = std::sin(view.field->half_angle);
  field_cosine_ = std::cos(view.field->half_angle);
  field_radius_ = view.field->radius;
}

glm::dvec3 ViewOracle::centerOf(int level, const Index3& cell) const {
  return (glm::dvec3(cell) + 0.5) * std::ldexp(1.0, level) * spacing_;
}

double ViewOracle::distanceFromField(const glm::dvec3& point) const {
  const glm::dvec3 from_eye = point - eye_;
  const double ahead = glm::dot(from_eye, direction_);
  const double beside = glm::length(from_eye - ahead * direction_);
  return is_parallel_ ? beside - field_radius_ : beside * field_cosine_ - ahead * field_sine_;
}

bool ViewOracle::refines(int level, const Index3& cell) const {
  if (level > last_level_) return true;
  const auto l = static_cast<std::size_t>(level);
  const glm::dvec3 center = centerOf(level, cell);
  const glm::dvec3 from_eye = center - eye_;
  if (!(glm::dot(from_eye, from_eye) < seen_within_squared_[l])) return false;
  return !has_field_ || distanceFromField(center) < near_field_within_[l];
}

// All centres lie within half the box's diagonal of its middle, and in its bounds of distance; both
// are widened by a millionth of their terms, so that they hold for certain.
Coverage ViewOracle::refinedCoverage(int level, const IndexBox& cells) const {
  if (level > last_level_) return Coverage::kAll;
  const auto l = static_cast<std::size_t>(level);
  if (seen_within_squared_[l] == 0.0) return Coverage::kNone;
  const glm::dvec3 low = centerOf(level, cells.first);
  const glm::dvec3 high = centerOf(level, cells.end() - Index3(1));
  const glm::dvec3 nearest = glm::clamp(eye_, low, high) - eye_;
  const glm::dvec3 farthest = glm::max(glm::abs(low - eye_), glm::abs(high - eye_));
  Coverage coverage = Coverage::kSome;
  if (glm::dot(farthest, farthest) * (1 + 1e-6) < seen_within_squared_[l])
    coverage = Coverage::kAll;
  if (glm::dot(nearest, nearest) * (1 - 1e-6) >= seen_within_squared_[l]) return Coverage::kNone;
  if (!has_field_) return coverage;
  const glm::dvec3 middle = 0.5 * (low + high);
  const double distance = distanceFromField(middle);
  const double reach =
      0.5 * glm::length(high - low) + 1e-6 * (glm::length(middle - eye_) + glm::length(spacing_));
  if (distance - reach >= near_field_within_[l]) return Coverage::kNone;
  return distance + reach < near_field_within_[l] ? coverage
                                                  : coarserCoverage(coverage, Coverage::kSome);
}

void ViewOracle::keepRefined(int level, const Index3& first, std::int64_t count,
                             std::uint64_t* bits) const {
  switch (refinedCoverage(level, {first, Index3(count, 1, 1)})) {
    case Coverage::kAll:
      return;
    case Coverage::kNone:
      std::fill(bits, bits + wordsOf(count), 0);
      return;
    case Coverage::kSome:
      break;
  }
  keepBitsWhere(bits, wordsOf(count), [&](std::int64_t i) {
    return refines(level, {first.x + i, first.y, first.z});
  });
}

}  // namespace isobrick
