#include "isobrick/extract/region/region_field.h"

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
