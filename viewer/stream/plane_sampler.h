// The volume's values on a parallelogram: for slices, and for the caps of cut surfaces.
#pragma once

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/stream/slice_store.h"

namespace isobrick {

// A parallelogram in voxel indices.
struct IndexPlane {
  glm::dvec3 corner{0.0}, across{0.0}, along{0.0};

  bool operator==(const IndexPlane&) const = default;
};

// The level whose samples are at most `most` to the longer side of the plane, and how many values
// each side then has.
struct PlaneSampling {
  int level = 0;
  int width = 2;
  int height = 2;
};
PlaneSampling samplingOf(const Lattice& lattice, const IndexPlane& plane, int most);

// Values interpolated trilinearly between samples of the sampling's level; NaN outside of the
// volume. Bricks are held one at a time. Throws Error for a damaged brick, and Cancelled.
SliceImage samplePlane(const Pyramid& pyramid, const IndexPlane& plane,
                       const PlaneSampling& sampling, const CancelFlag& cancel);

// The slice across `axis` of the voxels at `position`.
IndexPlane slicePlane(const Index3& voxels, int axis, double position);

// The part of the plane dot(normal, world) = offset that the box of the volume's voxels can meet,
// as a square around it; nothing if they do not meet.
std::optional<IndexPlane> capPlane(const Index3& voxels, const GridGeometry& geometry,
                                   const glm::dvec3& normal, double offset);

}  // namespace isobrick
