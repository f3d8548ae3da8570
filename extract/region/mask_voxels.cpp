#include "isobrick/extract/region/mask_voxels.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <string>

#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

MaskVoxels::MaskVoxels(const RegionMask& mask, const Pyramid& volume)
    : pyramid_(mask.pyramid), has_value_(mask.value.has_value()) {
  const ValueTransform& values = pyramid_->spec().values;
  stored_ = values.stored(mask.value.value_or(0));
  if (!has_value_ && values.isIdentity()) tolerance_ = 0;
  constexpr double kMostExact = 1 << 24;
  double most = std::abs(has_value_ ? stored_ : 0.0);
  if (const ValueRange& range = pyramid_->valueRange(); !values.isIdentity())
    most = std::max(most, static_cast<double>(std::max(std::abs(range.min), std::abs(range.max))));
  if (pyramid_->spec().voxel_type == VoxelType::kFloat32 && most > kMostExact)
    throw Error("the mask '" + pyramid_->path() +
                    "' holds float32 voxels, which do not tell whole numbers above 16777216 apart; "
                    "give a mask of smaller numbers",
                {.path = pyramid_->path()});
  const GridGeometry& own = mask.pyramid->spec().geometry;
  const GridGeometry& other = volume.spec().geometry;
  const glm::dmat3 from_world = glm::inverse(own.indexToWorldMatrix());
  to_mask_ = from_world * other.indexToWorldMatrix();
  first_ = from_world * (other.origin - own.origin);
  glm::dvec3 lower(std::numeric_limits<double>::infinity()), upper = -lower;
  double apart = glm::max(glm::max(std::abs(first_.x), std::abs(first_.y)), std::abs(first_.z));
  for (int axis = 0; axis < 3; ++axis)
    for (int row = 0; row < 3; ++row)
      apart = std::max(apart, std::abs(to_mask_[axis][row] - (axis == row ? 1.0 : 0.0)));
  constexpr double kSameGrid = 1e-3;  // voxels
  if (own.unit != other.unit && apart > kSameGrid)
    throw Error("the mask '" + mask.pyramid->path() + "' has lengths in units that are " +
                    std::string(lengthUnitName(own.unit)) + ", those of '" + volume.path() +
                    "' are " + std::string(lengthUnitName(other.unit)) +
                    ", and the grids differ; give both the same unit",
                {.path = mask.pyramid->path()});
  for (const glm::dvec3& corner : worldCorners(other, volume.spec().voxels)) {
    const glm::dvec3 at = from_world * (corner - own.origin);
    lower = glm::min(lower, at);
    upper = glm::max(upper, at);
  }
  for (int axis = 0; axis < 3; ++axis)
    if (upper[axis] < -0.5 ||
        lower[axis] > static_cast<double>(mask.pyramid->spec().voxels[axis]) - 0.5)
      throw Error("the mask '" + mask.pyramid->path() + "' lies nowhere in '" + volume.path() +
                      "': their places in the world do not meet; look at both with 'isobrick info'",
                  {.path = mask.pyramid->path()});
}

void MaskReader::throwIfReadsFailed() const {
  if (samples_.part.data() != nullptr) mask_.pyramid_->throwIfReadsFailed(0, brick_);
}

bool MaskReader::isIn(double stored) const {
  const bool is_near = std::abs(stored - mask_.stored_) <= mask_.tolerance_;
  return mask_.has_value_ ? is_near : !is_near && !std::isnan(stored);
}

bool MaskReader::has(const Index3& voxel) {
  const Pyramid& pyramid = *mask_.pyramid_;
  const glm::dvec3 place = glm::floor(mask_.to_mask_ * glm::dvec3(voxel) + mask_.first_ + 0.5);
  const Index3& voxels = pyramid.spec().voxels;
  for (int axis = 0; axis < 3; ++axis)
    if (!(place[axis] >= 0 && place[axis] < static_cast<double>(voxels[axis]))) return false;
  const Index3 at(place);
  const Index3 end = box_.end();
  if (at.x < box_.first.x || at.y < box_.first.y || at.z < box_.first.z || at.x >= end.x ||
      at.y >= end.y || at.z >= end.z) {
    throwIfReadsFailed();
    const BrickLayout& layout = pyramid.layout();
    brick_ = glm::min(at / layout.brickCells(), layout.bricks(0) - Index3(1));
    box_ = layout.brickSampleBox(0, brick_);
    all_.reset();
    samples_ = {};
    // Of one value, but for what lies around it. Ranges leave out voxels without data.
    const ValueRange range = pyramid.brickRange(0, brick_);
    if (range.min == range.max && !pyramid.spec().has_missing) {
      all_ = isIn(static_cast<double>(range.min));
      box_ = layout.brickOwnSamples(0, brick_);
    } else {
      samples_ = pyramid.samples(0, brick_, cancel_);
    }
  }
  if (all_) return *all_;
  const std::int64_t number = linearIndex(at - samples_.box.first, samples_.box.count);
  return visitVoxelType(pyramid.spec().voxel_type, [&](auto tag) {
    return isIn(static_cast<double>(samples_.data<typename decltype(tag)::Type>()[number]));
  });
}

}  // namespace isobrick
