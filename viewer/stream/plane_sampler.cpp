#include "isobrick/viewer/stream/plane_sampler.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>

namespace isobrick {
namespace {

// Reads samples of one level anywhere, and keeps the brick that was used last.
class LevelReader {
 public:
  LevelReader(const Pyramid& pyramid, int level)
      : pyramid_(pyramid), level_(level), cells_(pyramid.lattice().cells(level)) {}

  // At a voxel index; NaN outside of the volume.
  float at(const glm::dvec3& index) {
    const glm::dvec3 last(pyramid_.lattice().voxels() - Index3(1));
    constexpr double kRim = 1e-6;  // of rounding, in voxels
    if (!(glm::all(glm::greaterThanEqual(index, glm::dvec3(-kRim))) &&
          glm::all(glm::lessThanEqual(index, last + kRim))))
      return std::numeric_limits<float>::quiet_NaN();
    Index3 cell;
    glm::dvec3 share;
    for (int axis = 0; axis < 3; ++axis) {
      const double x = std::clamp(index[axis], 0.0, last[axis]);
      cell[axis] = std::min(static_cast<std::int64_t>(x) >> level_, cells_[axis] - 1);
      const auto low = static_cast<double>(pyramid_.lattice().position(level_, axis, cell[axis]));
      const auto high =
          static_cast<double>(pyramid_.lattice().position(level_, axis, cell[axis] + 1));
      share[axis] = (x - low) / (high - low);
    }
    takeBrickOf(cell);
    const Index3 first = cell - samples_.box.first;
    return visitVoxelType(pyramid_.spec().voxel_type, [&](auto tag) {
      return interpolate(samples_.data<typename decltype(tag)::Type>(), first, share);
    });
  }
  // Throws Error if bytes of a brick could not be read while they were used.
  void check() const {
    if (brick_.x >= 0) pyramid_.throwIfReadsFailed(level_, brick_);
  }

 private:
  void takeBrickOf(const Index3& cell) {
    const Index3 brick = cell / pyramid_.layout().brickCells();
    if (brick == brick_) return;
    check();
    samples_ = pyramid_.samples(level_, brick);
    brick_ = brick;
  }
  template <typename T>
  float interpolate(const T* values, const Index3& first, const glm::dvec3& share) const {
    double sum = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
      const Index3 step(corner & 1, corner >> 1 & 1, corner >> 2);
      const double weight = (step.x != 0 ? share.x : 1.0 - share.x) *
                            (step.y != 0 ? share.y : 1.0 - share.y) *
                            (step.z != 0 ? share.z : 1.0 - share.z);
      if (weight != 0.0)
        sum += weight * static_cast<double>(values[linearIndex(first + step, samples_.box.count)]);
    }
    return static_cast<float>(sum);
  }

  const Pyramid& pyramid_;
  int level_;
  Index3 cells_;
  Index3 brick_{-1};
  BrickSamples samples_;
};

}  // namespace

PlaneSampling samplingOf(const Lattice& lattice, const IndexPlane& plane, int most) {
  const double across = glm::length(plane.across), along = glm::length(plane.along);
  PlaneSampling sampling;
  const auto longest = [&] { return std::ldexp(std::max(across, along), -sampling.level); };
  while (longest() + 1.0 > most && sampling.level + 1 < lattice.levels()) ++sampling.level;
  const auto values = [&](double length) {
    return std::clamp(static_cast<int>(std::lround(std::ldexp(length, -sampling.level))) + 1, 2,
                      most);
  };
  sampling.width = values(across);
  sampling.height = values(along);
  return sampling;
}

SliceImage samplePlane(const Pyramid& pyramid, const IndexPlane& plane,
                       const PlaneSampling& sampling, const CancelFlag& cancel) {
  SliceImage image{sampling.width, sampling.height, {}, pyramid.spec().values};
  image.values.resize(static_cast<std::size_t>(sampling.width) *
                      static_cast<std::size_t>(sampling.height));
  LevelReader reader(pyramid, sampling.level);
  // In squares, so that a brick is taken once for each of them and not for every row.
  constexpr int kSquare = 64;
  for (int top = 0; top < sampling.height; top += kSquare) {
    for (int left = 0; left < sampling.width; left += kSquare) {
      cancel.check();
      for (int y = top; y < std::min(top + kSquare, sampling.height); ++y) {
        for (int x = left; x < std::min(left + kSquare, sampling.width); ++x) {
          const glm::dvec3 index = plane.corner + plane.across * (x / (sampling.width - 1.0)) +
                                   plane.along * (y / (sampling.height - 1.0));
          image.values[static_cast<std::size_t>(y) * static_cast<std::size_t>(sampling.width) +
                       static_cast<std::size_t>(x)] = reader.at(index);
        }
      }
    }
  }
  reader.check();
  return image;
}

IndexPlane slicePlane(const Index3& voxels, int axis, double position) {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  IndexPlane plane;
  plane.corner[axis] = position;
  plane.across[u] = static_cast<double>(voxels[u] - 1);
  plane.along[v] = static_cast<double>(voxels[v] - 1);
  return plane;
}

std::optional<IndexPlane> capPlane(const Index3& voxels, const GridGeometry& geometry,
                                   const glm::dvec3& normal, double offset) {
  // In the world: the plane's own axes, and how far the box reaches along them.
  const glm::dvec3 helper =
      std::abs(normal.z) < 0.9 ? glm::dvec3(0.0, 0.0, 1.0) : glm::dvec3(0.0, 1.0, 0.0);
  const glm::dvec3 u = glm::normalize(glm::cross(helper, normal));
  const glm::dvec3 v = glm::cross(normal, u);
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  glm::dvec3 lower(kInfinity), upper(-kInfinity);
  for (const glm::dvec3& corner : worldCorners(geometry, voxels)) {
    const glm::dvec3 place(glm::dot(corner, u), glm::dot(corner, v), glm::dot(corner, normal));
    lower = glm::min(lower, place);
    upper = glm::max(upper, place);
  }
  if (!(offset >= lower.z && offset <= upper.z)) return std::nullopt;
  const glm::dvec3 corner = u * lower.x + v * lower.y + normal * offset;
  const glm::dmat3 to_index = glm::inverse(geometry.indexToWorldMatrix());
  return IndexPlane{to_index * (corner - geometry.origin), to_index * (u * (upper.x - lower.x)),
                    to_index * (v * (upper.y - lower.y))};
}

}  // namespace isobrick
