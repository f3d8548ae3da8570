// OpenVDB files for tests, without OpenVDB's headers.
#pragma once

#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick::test {

// A fog volume: `values` at the voxels 0 .. voxels - 1, all of them active, around them 0. Voxel
// (0, 0, 0) is at `origin`.
void writeVdbFog(const std::string& path, const Index3& voxels, const std::vector<float>& values,
                 double spacing = 1, const glm::dvec3& origin = glm::dvec3(0));

// The level set of a ball: signed distances in a narrow band of 3 voxels, negative inside.
void writeVdbBall(const std::string& path, double radius, const glm::dvec3& center, double spacing);

}  // namespace isobrick::test
