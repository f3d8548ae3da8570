// --mask, --clip and --sphere as parts of a view, and back. Of the commands that have views.
#pragma once

#include "isobrick/viewer/state/view_file.h"
#include "tools/region_options.h"

namespace isobrick {

// In voxel indices.
inline ViewRegion viewRegionOf(const RegionOptions& options) {
  ViewRegion region;
  for (const RegionOptions::Mask& mask : options.masks)
    region.masks.push_back({wholeName(mask.input.path), mask.value});
  for (const auto& plane : options.planes) region.half_spaces.push_back(plane.shape);
  for (const auto& sphere : options.spheres)
    region.balls.push_back({sphere.shape.center, sphere.shape.radius});
  return region;
}

inline RegionOptions regionOptionsOf(const ViewRegion& region) {
  RegionOptions options;
  for (const ViewMask& mask : region.masks) {
    options.masks.emplace_back().input.path = mask.path;
    options.masks.back().value = mask.value;
  }
  for (const HalfSpace& half_space : region.half_spaces) options.planes.push_back({half_space});
  for (const ViewBall& ball : region.balls) options.spheres.push_back({{ball.center, ball.radius}});
  return options;
}

// After openMasks().
inline OpenMasks openMasksOf(const RegionOptions& options) {
  OpenMasks open;
  for (const RegionOptions::Mask& mask : options.masks)
    open[wholeName(mask.input.path)] = mask.opened;
  return open;
}

}  // namespace isobrick
