#include "isobrick/extract/wall_thickness.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <limits>
#include <optional>
#include <vector>

namespace isobrick {
namespace {

// All lengths are world units from the start.
struct Ray {
  std::size_t vertex = 0;
  glm::dvec3 start{0.0}, direction{0.0};
  double end = 0;                     // where the ray leaves the volume
  double from = 0, to = 0;            // where it was looked at last, and is looked at next
  double before = 0, behind = 0;      // a place where it turns from in to out, or from out to in
  std::optional<double> inside = {};  // where the ray came in, if it is in
};

// Where a ray that begins in a box leaves it; both in voxel indices.
double lengthWithin(const glm::dvec3& last, const glm::dvec3& start, const glm::dvec3& step) {
  double length = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis)
    if (step[axis] != 0)
      length = std::min(length, ((step[axis] > 0 ? last[axis] : 0) - start[axis]) / step[axis]);
  return std::max(length, 0.0);
}

}  // namespace

WallThickness::WallThickness(const Pyramid& pyramid, double isovalue, double most, InsideOf inside)
    : pyramid_(pyramid), field_(pyramid), inside_(inside), most_(most) {
  const float stored = pyramid.storedIsovalue(isovalue);
  const double outermost = static_cast<double>(
      inside == InsideOf::kAbove ? stored
                                 : std::nextafter(stored, -std::numeric_limits<float>::infinity()));
  // Between equal voxels the field is theirs but for roundings of double precision.
  const double rounding = 1e-14 * std::abs(outermost);
  outermost_ = inside == InsideOf::kAbove ? outermost - rounding : outermost + rounding;
}

void WallThickness::evaluate(std::span<const glm::dvec3> world, std::span<const glm::vec3> normals,
                             std::span<double> values) const {
  constexpr double kFirstStep = 1e-3, kStep = 0.5;  // voxels; shorter pieces are roundings
  constexpr int kHalvings = 20;
  const PyramidSpec& spec = pyramid_.spec();
  const double voxel = spec.geometry.leastSpacing();
  const glm::dmat3 to_index = glm::inverse(spec.geometry.indexToWorldMatrix());
  const glm::dvec3 last(spec.voxels - Index3(1));
  std::vector<Ray> all(world.size());
  std::vector<Ray*> rays, turning;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const glm::dvec3 direction = -glm::dvec3(normals[i]);
    const glm::dvec3 start =
        glm::clamp(to_index * (world[i] - spec.geometry.origin), glm::dvec3(0.0), last);
    all[i] = {i, spec.geometry.indexToWorld(start), direction};
    all[i].end = lengthWithin(last, start, to_index * direction);
    values[i] = std::numeric_limits<double>::quiet_NaN();
    if (std::isfinite(all[i].end)) rays.push_back(&all[i]);
  }

  // Whether rays turned before a place of theirs.
  std::vector<glm::dvec3> places;
  std::vector<double> found;
  const auto look = [&](const std::vector<Ray*>& some, const auto& placeOf, const auto& take) {
    places.clear();
    for (const Ray* ray : some) places.push_back(ray->start + placeOf(*ray) * ray->direction);
    found.resize(places.size());
    field_.evaluate(places, {}, found);
    for (std::size_t i = 0; i < some.size(); ++i) {
      const double stored = spec.values.stored(found[i]);
      const bool is_in = inside_ == InsideOf::kAbove ? stored >= outermost_ : stored <= outermost_;
      take(*some[i], is_in != some[i]->inside.has_value(), std::isnan(stored));
    }
  };
  // All go on together, so that bricks serve many of them.
  for (double step = kFirstStep * voxel; !rays.empty(); step = kStep * voxel) {
    turning.clear();
    for (Ray* ray : rays) ray->to = std::min(ray->from + step, ray->end);
    look(
        rays, [](const Ray& ray) { return ray.to; },
        [&](Ray& ray, bool has_turned, bool has_none) {
          ray.before = ray.from;
          ray.behind = ray.to;
          if (has_none)
            ray.end = -1;
          else if (has_turned)
            turning.push_back(&ray);
        });
    const auto middleOf = [](const Ray& ray) { return (ray.before + ray.behind) / 2; };
    for (int halving = 0; halving < kHalvings && !turning.empty(); ++halving)
      look(turning, middleOf, [&](Ray& ray, bool has_turned, bool) {
        (has_turned ? ray.behind : ray.before) = middleOf(ray);
      });
    for (Ray* ray : turning) {
      const double length = ray->behind - ray->inside.value_or(ray->behind);
      if (!ray->inside) {
        ray->inside = ray->behind;
      } else if (length >= kFirstStep * voxel) {
        values[ray->vertex] = std::min(length, most_);
        ray->end = -1;
      } else {
        ray->inside.reset();
      }
    }
    std::erase_if(rays, [&](Ray* ray) {
      if (ray->end < 0) return true;
      ray->from = ray->to;
      const double length = ray->to - ray->inside.value_or(0);
      if (length < most_ && ray->to < ray->end) return false;
      if (ray->inside) values[ray->vertex] = std::min(length, most_);
      return true;
    });
  }
}

}  // namespace isobrick
