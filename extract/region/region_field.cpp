#include "isobrick/extract/region/region_field.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

bool isAboveZeroAndFinite(double number) { return number > 0 && std::isfinite(number); }

const SurfaceRegion& checkedRegion(const SurfaceRegion& region) {
  for (const HalfSpace& half_space : region.half_spaces)
    if (!isAboveZeroAndFinite(glm::length(half_space.normal)) || !std::isfinite(half_space.offset))
      throw Error(
          "a clip plane needs a normal of three finite numbers, not all 0, and a finite offset");
  for (const RegionBall& ball : region.balls)
    if (!isAboveZeroAndFinite(ball.radius) || !std::isfinite(glm::length(ball.center)) ||
        !isAboveZeroAndFinite(std::abs(glm::determinant(ball.to_units))))
      throw Error("a sphere needs a finite centre and a finite radius above 0");
  return region;
}

}  // namespace

RegionWall::RegionWall(const HalfSpace& half_space)
    : is_ball_(false),
      at_(glm::normalize(half_space.normal)),
      size_(half_space.offset / glm::length(half_space.normal)) {}

RegionWall::RegionWall(const RegionBall& ball)
    : is_ball_(true),
      at_(ball.center),
      size_(ball.radius),
      to_units_(ball.to_units),
      per_voxel_(std::cbrt(std::abs(glm::determinant(ball.to_units)))) {
  const glm::dmat3 to_voxels = glm::inverse(ball.to_units);
  for (int axis = 0; axis < 3; ++axis)
    reach_[axis] = ball.radius * glm::length(glm::dvec3(to_voxels[0][axis], to_voxels[1][axis],
                                                        to_voxels[2][axis]));
}

double RegionWall::depth(const glm::dvec3& point) const {
  if (!is_ball_) return glm::dot(at_, point) - size_;
  return (size_ - glm::length(to_units_ * (point - at_))) / per_voxel_;
}

double RegionWall::crossing(const glm::dvec3& inside, const glm::dvec3& outside) const {
  if (!is_ball_) {
    const double before = depth(inside), behind = depth(outside);
    return std::clamp(before / (before - behind), 0.0, 1.0);
  }
  const glm::dvec3 from = to_units_ * (inside - at_), way = to_units_ * (outside - inside);
  const double a = glm::dot(way, way), b = glm::dot(from, way);
  const double c = std::min(glm::dot(from, from) - size_ * size_, 0.0);
  return std::clamp((std::sqrt(b * b - a * c) - b) / a, 0.0, 1.0);
}

glm::dvec3 RegionWall::inward(const glm::dvec3& point) const {
  return is_ball_ ? glm::transpose(to_units_) * (to_units_ * (at_ - point)) : at_;
}

BoxSide RegionWall::sideOf(const glm::dvec3& lower, const glm::dvec3& upper) const {
  int inside = 0;
  for (unsigned i = 0; i < 8; ++i)
    inside += depth({(i & 1u) != 0 ? upper.x : lower.x, (i & 2u) != 0 ? upper.y : lower.y,
                     (i & 4u) != 0 ? upper.z : lower.z}) >= 0
                  ? 1
                  : 0;
  if (inside == 8) return BoxSide::kInside;
  if (!is_ball_) return inside == 0 ? BoxSide::kOutside : BoxSide::kCut;
  for (int axis = 0; axis < 3; ++axis)
    if (lower[axis] > at_[axis] + reach_[axis] || upper[axis] < at_[axis] - reach_[axis])
      return BoxSide::kOutside;
  return BoxSide::kCut;
}

std::vector<RegionWall> wallsOf(const SurfaceRegion& region) {
  std::vector<RegionWall> walls;
  for (const HalfSpace& half_space : region.half_spaces) walls.emplace_back(half_space);
  for (const RegionBall& ball : region.balls) walls.emplace_back(ball);
  return walls;
}

RegionField::RegionField(const SurfaceRegion& region, const Pyramid& volume)
    : region_(checkedRegion(region)), walls_(wallsOf(region)) {
  for (const RegionMask& mask : region.masks) masks_.emplace_back(mask, volume);
}

std::vector<MaskReader> RegionField::readers(const CancelFlag* cancel) const {
  std::vector<MaskReader> all;
  for (const MaskVoxels& mask : masks_) all.emplace_back(mask, cancel);
  return all;
}

BoxSide RegionField::sideOf(const Index3& lower, const Index3& upper) const {
  BoxSide side = masks_.empty() ? BoxSide::kInside : BoxSide::kCut;
  for (const RegionWall& wall : walls_) {
    const BoxSide one = wall.sideOf(glm::dvec3(lower), glm::dvec3(upper));
    if (one == BoxSide::kOutside) return one;
    if (one == BoxSide::kCut) side = one;
  }
  return side;
}

bool RegionField::has(const Index3& voxel, std::vector<MaskReader>& readers) const {
  for (const RegionWall& wall : walls_)
    if (wall.depth(glm::dvec3(voxel)) < 0) return false;
  return haveAll(readers, voxel);
}

}  // namespace isobrick
