#include "isobrick/viewer/session/shown_volume.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace isobrick {

ShownVolume::ShownVolume(std::shared_ptr<const Pyramid> pyramid,
                         const std::optional<PreviewOf>& preview_of, std::vector<double> isovalues,
                         OpenMasks masks, bool is_step)
    : pyramid_(std::move(pyramid)), preview_of_(preview_of), masks_(std::move(masks)) {
  volume_.voxels = pyramid_->spec().voxels;
  volume_.geometry = pyramid_->spec().geometry;
  volume_.least_value = pyramid_->realRange().min;
  volume_.greatest_value = pyramid_->realRange().max;
  volume_.stored_values = pyramid_->spec().values;
  volume_.isovalues = std::move(isovalues);
  volume_.has_all_values = !is_step;
  if (!preview_of_) return;
  volume_.voxels = preview_of_->voxels;
  volume_.geometry.spacing /= step();
  volume_.has_all_values = false;
}

int ShownVolume::firstLevel() const {
  return preview_of_ ? std::countr_zero(static_cast<std::uint64_t>(preview_of_->step)) : 0;
}

SceneLattice ShownVolume::lattice() const {
  const GridGeometry& samples = pyramid_->spec().geometry;
  return {samples.indexToWorldMatrix(), samples.origin};
}

WorldBox ShownVolume::boxAround(const std::array<glm::dvec3, 2>& samples) const {
  return volume_.boxAround(step() * samples[0], step() * samples[1]);
}

double ShownVolume::radiusAtRest(const ViewState& state) const {
  return preview_of_ ? volume_.diagonal() : wantedRadius(state, volume_);
}

double ShownVolume::radiusOfPass(const SurfaceWish& wish, double radius) const {
  if (!isOfOneLevel(wish, radius)) return radius;
  return std::ldexp(volume_.diagonal(), -levelOf(radius));
}

bool ShownVolume::isOfOneLevel(const SurfaceWish& wish, double radius) const {
  return wish.is_whole && radius < wish.radius;
}

int ShownVolume::levelOf(double radius) const {
  constexpr double kNearly = 0.25;  // of a level, which is 1.4 times the triangles
  const double level = std::ceil(std::log2(volume_.diagonal() / radius) - kNearly);
  return std::min(static_cast<int>(level), firstLevel() + pyramid_->lattice().levels() - 1);
}

SurfaceWish ShownVolume::wishOf(const ViewState& state, double height) const {
  SurfaceWish wish = isobrick::wishOf(state, volume_, height);
  wish.radius = radiusAtRest(state);
  return wish;
}

Query ShownVolume::queryOf(const SurfaceWish& wish, std::size_t surface, double radius) const {
  Query query = wholeQueryOf(wish, surface, radius);
  if (wish.detail.region.isEverywhere()) return query;
  query.region = surfaceRegionOf(wish.detail.region, masks_, step());
  query.cap = false;  // that would need level 0 at once
  return query;
}

Query ShownVolume::wholeQueryOf(const SurfaceWish& wish, std::size_t surface, double radius) const {
  Query query = isobrick::queryOf(wish, volume_, surface, radius);
  if (isOfOneLevel(wish, radius)) {
    query.focus.reset();
    query.curvature_tolerance.reset();
    query.uniform_level = std::max(0, levelOf(radius) - firstLevel());
    if (preview_of_) query.view.reset();
    return query;
  }
  if (!preview_of_) return query;
  Query coarse;
  coarse.isovalue = query.isovalue;
  coarse.inside = query.inside;
  coarse.cap = query.cap;
  if (query.focus)
    coarse.focus = FocusSphere{query.focus->center / step(), query.focus->radius / step()};
  return coarse;
}

}  // namespace isobrick
