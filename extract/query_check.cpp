#include "isobrick/extract/query_check.h"

#include <cmath>
#include <limits>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// In voxels from the volume's first voxel.
constexpr double kFarthestFocus = 0x1p30;

void checkFocus(const FocusSphere& focus) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!std::isfinite(focus.center[axis]))
      throw Error("the focus point is not finite; give three numbers");
    // Squared distances beyond would be coarser than the room that rule 3 has for rounding.
    if (std::abs(focus.center[axis]) > kFarthestFocus)
      throw Error("the focus point is more than 2^30 voxels away; move it towards the volume");
  }
  if (!(focus.radius >= 0) || !std::isfinite(focus.radius))
    throw Error("the radius of interest must be a finite number >= 0");
}

void checkUniformLevel(const Pyramid& pyramid, int level) {
  const int levels = pyramid.lattice().levels();
  if (level < 0 || level >= levels)
    throw Error("level " + std::to_string(level) + " does not exist in '" + pyramid.path() +
                "'; its levels are 0 to " + std::to_string(levels - 1));
}

void checkCurvatureTolerance(const Pyramid& pyramid, const Query& query) {
  if (!(*query.curvature_tolerance >= 0))
    throw Error("the curvature tolerance must be a number >= 0");
  if (query.uniform_level && *query.uniform_level > 0)
    throw Error("the curvature tolerance acts on level 0; leave out the uniform level");
  if (!pyramid.spec().has_curvature)
    throw Error(
        "'" + pyramid.path() + "' holds no curvature; build it with curvature to use a tolerance",
        {.path = pyramid.path()}, {Remedy::kBuildWithCurvature});
}

void checkBox(const QueryBox& box) {
  for (int axis = 0; axis < 3; ++axis)
    if (!(box.min[axis] < box.max[axis]))
      throw Error("the box is empty; its first corner must be below its second on every axis");
}

}  // namespace

void checkQuery(const Pyramid& pyramid, const Query& query) {
  // Compared as float.
  if (!(std::abs(query.isovalue) <= static_cast<double>(std::numeric_limits<float>::max())))
    throw Error("the isovalue is not a finite number; choose one within the volume's value range");
  if (query.focus && query.uniform_level)
    throw Error("a focus and a uniform level exclude each other; give one of them");
  if (query.focus) checkFocus(*query.focus);
  if (query.uniform_level) checkUniformLevel(pyramid, *query.uniform_level);
  if (query.curvature_tolerance) checkCurvatureTolerance(pyramid, query);
  if (query.box) checkBox(*query.box);
}

}  // namespace isobrick
