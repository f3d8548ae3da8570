#include "isobrick/preprocess/sources/source_checks.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Cosine between two axes up to which a direction counts as orthogonal but written carelessly.
constexpr double kMostSkew = 2e-3;
// Cosine that a matrix of single-precision numbers (NIfTI, DICOM decimal strings) may show.
constexpr double kRoundingSkew = 1e-5;

}  // namespace

std::string quotedText(const std::string& text, std::size_t most_characters) {
  std::string result(1, '\'');
  result.append(text, 0, most_characters);
  for (char& c : result)
    if (static_cast<unsigned char>(c) < ' ') c = ' ';
  result += text.size() > most_characters ? "...'" : "'";
  return result;
}

void checkVoxelCounts(const std::string& path, const Index3& voxels) {
  const std::string counts = "it has " + indexText(voxels, " x ") + " voxels, and isobrick ";
  for (int axis = 0; axis < 3; ++axis) {
    if (voxels[axis] < 2)
      throw unusable(path, counts + "needs at least 2 voxels per axis; choose a 3-D volume");
    if (voxels[axis] > kMaxVoxelsPerAxis)
      throw unusable(path, counts + "takes at most " + std::to_string(kMaxVoxelsPerAxis) +
                               " per axis; check the dimensions or cut the volume");
  }
}

void tidyGeometry(const std::string& path, GridGeometry& geometry,
                  std::vector<std::string>& notes) {
  glm::dmat3& direction = geometry.direction;
  for (int axis = 0; axis < 3; ++axis) {
    double& spacing = geometry.spacing[axis];
    const double length = glm::length(direction[axis]);
    if (!std::isfinite(spacing) || spacing == 0 || !std::isfinite(geometry.origin[axis]))
      throw unusable(path, "spacing or origin of axis " + std::to_string(axis) +
                               " is zero or not a number; correct its header");
    if (!std::isfinite(length) || length < 0.5)
      throw unusable(path, "the direction of axis " + std::to_string(axis) +
                               " is not a unit vector; correct its header");
    direction[axis] /= spacing < 0 ? -length : length;
    direction[axis] += 0.0;  // no negative zeros
    spacing = std::abs(spacing);
  }
  double skew = 0;
  for (int axis = 0; axis < 3; ++axis)
    skew = std::max(skew, std::abs(glm::dot(direction[axis], direction[(axis + 1) % 3])));
  if (skew > kMostSkew)
    throw unusable(
        path,
        "its axes are not at right angles but up to " +
            std::to_string(std::asin(std::min(skew, 1.0)) * 180 / std::numbers::pi) +
            " degrees off (sheared, or a tilted gantry); resample it to a rectangular grid first");
  if (skew > kRoundingSkew)
    notes.push_back("axes that were not quite at right angles were straightened");
  if (skew == 0) return;  // axis-aligned directions keep their exact bits
  const double handedness = glm::determinant(direction) < 0 ? -1 : 1;
  direction[1] = glm::normalize(direction[1] - direction[0] * glm::dot(direction[0], direction[1]));
  direction[2] = glm::cross(direction[0], direction[1]) * handedness;
}

}  // namespace isobrick
