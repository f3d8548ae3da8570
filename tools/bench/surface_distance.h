// How far two surfaces lie apart.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick {

struct PlainMesh {
  std::vector<glm::vec3> positions;                     // in voxel indices
  std::vector<std::array<std::uint32_t, 3>> triangles;  // numbers of positions
};

// A temporary file, in the byte order of this machine, in which a row's process leaves its mesh:
// two numbers of 64 bits (positions, triangles), then these. Both throw Error that names the file;
// reading also if its size or a number in it does not fit.
void writePlainMesh(const PlainMesh& mesh, const std::string& path);
PlainMesh readPlainMesh(const std::string& path);

// From the points of one surface to the nearest points of another, in voxels. Infinite if the other
// has no triangles; 0 if the first has no points.
struct OneWayDistance {
  double mean = 0;
  double p99 = 0;  // 99 % of the area is no further away
  double max = 0;
  std::uint64_t points = 0;
};

struct DistanceOptions {
  // Points are taken evenly from a surface so that there are about that many at most.
  std::size_t most_points = 2'000'000;
  // Only points at least a voxel inside of [0, voxels - 1] count: OpenVDB closes surfaces at the
  // volume's border, and others leave them open there.
  Index3 voxels{0};
};

// The points are the vertices and the centroids of the triangles; a triangle that is longer than a
// voxel is cut into pieces of a voxel first. Mean and 99 % are over the area (centroids, each with
// the area of its piece), the maximum is over all points. Uses the calling TBB arena.
OneWayDistance distanceFrom(const PlainMesh& from, const PlainMesh& to,
                            const DistanceOptions& options);

}  // namespace isobrick
