// The one grid of a volume (rule 16 of the design), in millimetres, out of what its header says of
// the places of its voxels and the units of these. Private to preprocess/sources/.
#pragma once

#include <array>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// The numbers of info.geometry along the world's axes are in these units, "" if none is stated.
// Converts them to millimetres, with a note if they were not. If a unit is missing or no length,
// all numbers stay and their unit is unknown, with a note if a file states only some units.
void takeLengthUnits(const std::array<std::string, 3>& units, VolumeInfo& info);

// Where a header puts voxel (i, j, k): at origin + steps * (i, j, k).
struct StatedPlaces {
  glm::dmat3 steps{1.0};  // columns of any length, sign and angle
  glm::dvec3 origin{0.0};
  // If it states the place of each slice: that of voxel (0, 0, k), one for each k. They stand for
  // steps[2] and origin, which are made of the first and the last.
  std::vector<glm::dvec3> slices = {};
};

// The grid of right angles that is nearest to these places; its unit is unknown. An axis that is
// named backwards keeps its sense: steps of either handedness are kept. Adds a note if a voxel lies
// more than a thousandth of a voxel from its stated place. Throws Error, with the figure, if it is
// more than a hundredth; and for steps that are zero, not finite or in one plane.
GridGeometry oneGrid(const std::string& path, const StatedPlaces& stated, const Index3& voxels,
                     std::vector<std::string>& notes);

// The same of a spacing of either sign and directions of any length, which become what GridGeometry
// promises. Axes at right angles keep their exact bits.
void tidyGeometry(const std::string& path, GridGeometry& geometry, const Index3& voxels,
                  std::vector<std::string>& notes);

}  // namespace isobrick
