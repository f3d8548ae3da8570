// What a caller asks for: one isosurface, and how fine it shall be where.
#pragma once

#include <optional>

#include "isobrick/storage/cancel.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// The sphere of interest (Sect. 5.1 of the paper): level 0 inside, coarser with distance. Voxel
// index coordinates and voxels; the centre may lie outside the volume, up to 2^30 voxels away on
// each axis.
struct FocusSphere {
  glm::dvec3 center{0.0};
  double radius = 0;
};

// A closed box in voxel index coordinates.
struct QueryBox {
  glm::dvec3 min{0.0};
  glm::dvec3 max{0.0};
};

struct Query {
  // The surface separates value >= isovalue (inside) from value < isovalue. Compared as float.
  double isovalue = 0;
  // Without a focus the finest level is extracted everywhere. Not together with uniform_level.
  std::optional<FocusSphere> focus;
  // Extracts the whole surface from this level, 0 .. levels - 1.
  std::optional<int> uniform_level;
  // Cells of level 1 inside the sphere of interest (everywhere without a focus) are extracted as
  // they are where the bound of the total curvature (Eq. 2) is at most this: 1/voxel^2, >= 0.
  // "Flatter than a sphere of radius rho voxels" is 1 / (2 rho^2). Not with uniform_level > 0.
  std::optional<double> curvature_tolerance;
  // Only leaves that overlap this box are extracted, as a whole; the surface is open there.
  std::optional<QueryBox> box;
  // Off: every brick and every tile is visited. The mesh is the same (rule 7); for tests.
  bool cull_by_ranges = true;
  const CancelFlag* cancel = nullptr;
};

}  // namespace isobrick
