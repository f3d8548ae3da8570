#include "isobrick/extract/pyramid_values.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <limits>
#include <vector>

#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {
namespace {

// A position in the cell that holds it.
struct Place {
  std::size_t brick_row = 0;
  std::size_t position = 0;  // index in the caller's positions
  Index3 brick{0};
  Index3 cell{0};
  glm::dvec3 fraction{0.0};  // 0 .. 1 in the cell
};

// Of a place at a sample, whose neighbours may be NaN.
template <typename T>
double sampleAt(const T* samples, const IndexBox& box, const Place& place) {
  const Index3 sample = place.cell + Index3(place.fraction);
  return static_cast<double>(samples[linearIndex(sample - box.first, box.count)]);
}

template <typename T>
double interpolate(const T* samples, const IndexBox& box, const Place& place) {
  const T* at = samples + linearIndex(place.cell - box.first, box.count);
  const std::int64_t row = box.count.x, slice = box.count.x * box.count.y;
  const glm::dvec3& t = place.fraction;
  const auto alongX = [&](const T* p) {
    return static_cast<double>(p[0]) * (1 - t.x) + static_cast<double>(p[1]) * t.x;
  };
  const auto alongY = [&](const T* p) { return alongX(p) * (1 - t.y) + alongX(p + row) * t.y; };
  return alongY(at) * (1 - t.z) + alongY(at + slice) * t.z;
}

}  // namespace

PyramidValues::PyramidValues(const Pyramid& pyramid, Sampling sampling)
    : pyramid_(pyramid),
      sampling_(sampling),
      origin_(pyramid.spec().geometry.origin),
      world_to_index_(glm::inverse(pyramid.spec().geometry.indexToWorldMatrix())) {}

void PyramidValues::evaluate(std::span<const glm::dvec3> world, std::span<const glm::vec3>,
                             std::span<double> values) const {
  const Index3 voxels = pyramid_.spec().voxels;
  const glm::dvec3 last(voxels - Index3(1));
  std::vector<Place> places;
  places.reserve(world.size());
  for (std::size_t i = 0; i < world.size(); ++i) {
    const glm::dvec3 index = world_to_index_ * (world[i] - origin_);
    glm::dvec3 inside = glm::clamp(index, glm::dvec3(0.0), last);
    const glm::dvec3 away = glm::abs(index - inside);
    if (!(std::max({away.x, away.y, away.z}) <= 0.5)) {
      values[i] = std::numeric_limits<double>::quiet_NaN();
      continue;
    }
    if (sampling_ == Sampling::kNearest) inside = glm::floor(inside + 0.5);
    Place place;
    place.position = i;
    place.cell = glm::min(Index3(glm::floor(inside)), voxels - Index3(2));
    place.fraction = inside - glm::dvec3(place.cell);
    place.brick = place.cell / pyramid_.spec().brick_cells;
    place.brick_row = pyramid_.parts().brickRow(0, place.brick);
    places.push_back(place);
  }
  outside_ += world.size() - places.size();

  // Brick by brick, so that no more than one is held.
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.brick_row < b.brick_row; });
  visitVoxelType(pyramid_.spec().voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    for (std::size_t begin = 0; begin < places.size();) {
      const BrickSamples samples = pyramid_.samples(0, places[begin].brick);
      const T* data = samples.template data<T>();
      const std::size_t row = places[begin].brick_row;
      const Index3 brick = places[begin].brick;
      for (; begin < places.size() && places[begin].brick_row == row; ++begin)
        values[places[begin].position] = pyramid_.spec().values.real(
            sampling_ == Sampling::kNearest ? sampleAt(data, samples.box, places[begin])
                                            : interpolate(data, samples.box, places[begin]));
      pyramid_.throwIfReadsFailed(0, brick);
    }
  });
}

AttributeType labelTypeOf(const Pyramid& pyramid) {
  const PyramidSpec& spec = pyramid.spec();
  const bool is_whole = spec.voxel_type != VoxelType::kFloat32 && spec.values.scale == 1 &&
                        spec.values.offset == std::floor(spec.values.offset);
  const RealRange range = pyramid.realRange();
  const auto isWithin = [&]<typename T>(T) {
    return is_whole && range.min >= std::numeric_limits<T>::min() &&
           range.max <= std::numeric_limits<T>::max();
  };
  if (isWithin(std::uint32_t{})) return AttributeType::kUint32;
  return isWithin(std::int32_t{}) ? AttributeType::kInt32 : AttributeType::kFloat64;
}

}  // namespace isobrick
