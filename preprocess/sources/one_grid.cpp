#include "isobrick/preprocess/sources/one_grid.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <string_view>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/length_scale.h"

namespace isobrick {

void takeLengthUnits(const std::array<std::string, 3>& units, VolumeInfo& info) {
  GridGeometry& geometry = info.geometry;
  geometry.unit = LengthUnit::kUnknown;
  if (units == std::array<std::string, 3>{}) return;
  std::string names;
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (!units[axis].empty() && std::find(units.begin(), units.begin() + axis, units[axis]) ==
                                    units.begin() + static_cast<std::ptrdiff_t>(axis))
      names += (names.empty() ? "" : ", ") + quotedText(units[axis], 40);
  std::array<LengthScale, 3> scales;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto scale = lengthScale(units[axis]);
    if (!scale) {
      info.notes.push_back(
          "lengths are as in the file and their unit is unknown: it says " + names +
          (units[axis].empty() ? std::string(", and of ") + "xyz"[axis] + " nothing"
                               : ", which is not all a length"));
      return;
    }
    scales[axis] = *scale;
  }
  geometry.unit = LengthUnit::kMillimetre;
  if (scales == std::array<LengthScale, 3>{}) return;
  // The steps of an oblique grid go along several of the world's axes.
  const bool is_one_scale = scales[1] == scales[0] && scales[2] == scales[0];
  info.stated_lengths = is_one_scale ? std::optional(scales[0]) : std::nullopt;
  const bool keeps_directions = is_one_scale || geometry.direction == glm::dmat3(1.0);
  for (int axis = 0; axis < 3; ++axis) {
    const LengthScale& scale = scales[static_cast<std::size_t>(axis)];
    geometry.origin[axis] = scale.of(geometry.origin[axis]);
    if (keeps_directions) {
      geometry.spacing[axis] = scale.of(geometry.spacing[axis]);
      continue;
    }
    glm::dvec3 step = geometry.direction[axis] * geometry.spacing[axis];
    for (int row = 0; row < 3; ++row)
      step[row] = scales[static_cast<std::size_t>(row)].of(step[row]);
    geometry.spacing[axis] = glm::length(step);
    if (geometry.spacing[axis] > 0) geometry.direction[axis] = step / geometry.spacing[axis];
  }
  info.notes.push_back("lengths were scaled from " + names + " to millimetres");
}

namespace {

// Distances from the stated places, in voxels: that is refused, and that is worth a note.
constexpr double kMostOff = 0.01;
constexpr double kNotedOff = 0.001;

// The greatest cosine between two of three unit vectors.
double skewOf(const glm::dmat3& axes) {
  double skew = 0;
  for (int axis = 0; axis < 3; ++axis)
    skew = std::max(skew, std::abs(glm::dot(axes[axis], axes[(axis + 1) % 3])));
  return skew;
}

// The orthonormal matrix nearest to `m`, by Newton's iteration for the polar decomposition.
glm::dmat3 nearestOrthonormal(glm::dmat3 m) {
  for (int i = 0; i < 200; ++i) {
    const glm::dmat3 next = (m + glm::inverse(glm::transpose(m))) * 0.5;
    double change = 0;
    for (int axis = 0; axis < 3; ++axis)
      change = std::max(change, glm::length(next[axis] - m[axis]));
    m = next;
    if (change < 1e-15) break;
  }
  return m;
}

// The grid of the steps, from the stated first voxel. A long axis weighs more than a short one,
// because its end is moved further by the same turn.
GridGeometry gridOfSteps(const std::string& path, const StatedPlaces& stated,
                         const Index3& voxels) {
  GridGeometry grid;
  grid.origin = stated.origin;
  for (int axis = 0; axis < 3; ++axis) {
    grid.spacing[axis] = glm::length(stated.steps[axis]);
    if (!std::isfinite(grid.spacing[axis]) || grid.spacing[axis] == 0 ||
        !std::isfinite(grid.origin[axis]))
      throw unusable(path, "spacing or origin of axis ", axis,
                     " is zero or not a number; correct its header");
    grid.direction[axis] = stated.steps[axis] / grid.spacing[axis] + 0.0;  // no negative zeros
  }
  if (skewOf(grid.direction) == 0) return grid;  // exact bits
  if (std::abs(glm::determinant(grid.direction)) < 1e-3)
    throw unusable(path, "its axes lie in one plane; correct its header");
  glm::dmat3 weighted;
  const auto longest =
      static_cast<double>(std::max({voxels.x, voxels.y, voxels.z, std::int64_t{2}}) - 1);
  for (int axis = 0; axis < 3; ++axis) {
    const double extent =
        static_cast<double>(std::max<std::int64_t>(voxels[axis] - 1, 1)) / longest;
    weighted[axis] = stated.steps[axis] * (grid.spacing[axis] * extent * extent);
  }
  weighted /= std::cbrt(std::abs(glm::determinant(weighted)));
  grid.direction = nearestOrthonormal(weighted);
  for (int axis = 0; axis < 3; ++axis)
    grid.spacing[axis] = glm::dot(stated.steps[axis], grid.direction[axis]);
  return grid;
}

// The greatest distance of a corner of a slice from its stated place, in voxels of `grid`; all
// other voxels lie nearer.
double greatestOff(const StatedPlaces& stated, const GridGeometry& grid, const Index3& voxels) {
  const glm::dvec3 last(voxels - Index3(1));
  const glm::dmat3 to_index = glm::inverse(grid.indexToWorldMatrix());
  double off = 0;
  const auto look = [&](const glm::dvec3& first, double k) {
    for (const double i : {0.0, last.x})
      for (const double j : {0.0, last.y}) {
        const glm::dvec3 place = first + stated.steps[0] * i + stated.steps[1] * j;
        off = std::max(off, glm::length(to_index * (place - grid.origin) - glm::dvec3(i, j, k)));
      }
  };
  for (std::size_t k = 0; k < stated.slices.size(); ++k)
    look(stated.slices[k], static_cast<double>(k));
  if (stated.slices.empty())
    for (const double k : {0.0, last.z}) look(stated.origin + stated.steps[2] * k, k);
  return off;
}

// From the middle of the volume as `grid` has it to where it is stated.
glm::dvec3 shiftOfMiddle(const StatedPlaces& stated, const GridGeometry& grid,
                         const Index3& voxels) {
  const glm::dvec3 middle = glm::dvec3(voxels - Index3(1)) * 0.5;
  return stated.origin + stated.steps * middle - grid.indexToWorld(middle);
}

}  // namespace

GridGeometry oneGrid(const std::string& path, const StatedPlaces& stated_places,
                     const Index3& voxels, std::vector<std::string>& notes) {
  StatedPlaces stated = stated_places;
  if (stated.slices.size() > 1) {
    stated.origin = stated.slices.front();
    stated.steps[2] =
        (stated.slices.back() - stated.origin) / static_cast<double>(stated.slices.size() - 1);
  }
  GridGeometry grid = gridOfSteps(path, stated, voxels);
  double off = greatestOff(stated, grid, voxels);
  if (off > kMostOff) {  // half of that, if the first voxel may move too
    GridGeometry centred = grid;
    centred.origin += shiftOfMiddle(stated, grid, voxels);
    if (const double centred_off = greatestOff(stated, centred, voxels); centred_off < off) {
      grid = centred;
      off = centred_off;
    }
  }
  if (off <= kNotedOff) return grid;
  glm::dmat3 axes = stated.steps;
  for (int axis = 0; axis < 3; ++axis) axes[axis] = glm::normalize(axes[axis]);
  const double degrees = std::asin(std::min(skewOf(axes), 1.0)) * 180 / std::numbers::pi;
  StatedPlaces even = stated;
  even.slices.clear();
  const std::string why =
      greatestOff(even, grid, voxels) >= off / 2
          ? "its axes are not at right angles but up to " + shortText(degrees) + " degrees off"
          : std::string("its slices are not at even places on one line");
  const std::string how_much = "up to " + shortText(off) + " of a voxel from where it has them";
  // Not so for few figures of a number.
  if (!(off <= kMostOff))
    throw unusable(path, why, ", so that a grid has voxels ", how_much,
                   "; resample it to a rectangular grid first");
  notes.push_back(why + "; voxels were put " + how_much);
  return grid;
}

void tidyGeometry(const std::string& path, GridGeometry& geometry, const Index3& voxels,
                  std::vector<std::string>& notes) {
  const LengthUnit unit = geometry.unit;
  glm::dmat3& direction = geometry.direction;
  bool is_at_right_angles = true;
  for (int axis = 0; axis < 3; ++axis) {
    double& spacing = geometry.spacing[axis];
    const double length = glm::length(direction[axis]);
    if (!std::isfinite(length) || length < 0.5)
      throw unusable(path, "the direction of axis ", axis,
                     " is not a unit vector; correct its header");
    direction[axis] /= spacing < 0 ? -length : length;
    direction[axis] += 0.0;  // no negative zeros
    spacing = std::abs(spacing);
    is_at_right_angles = is_at_right_angles && std::isfinite(spacing) && spacing > 0 &&
                         std::isfinite(geometry.origin[axis]);
  }
  if (is_at_right_angles && skewOf(direction) == 0) return;
  geometry = oneGrid(path, {geometry.indexToWorldMatrix(), geometry.origin}, voxels, notes);
  geometry.unit = unit;
}

}  // namespace isobrick
