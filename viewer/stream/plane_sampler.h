// The volume's values on a parallelogram: for slices, for the caps of cut surfaces, and as a
// picture for a screen with the contours of surfaces in it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {

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

// The samples around a cell, interpolated trilinearly. `cell` counts in the `count` samples of a
// brick; `share`: of the cell, along each axis, 0 .. 1. Samples that have no weight do not count.
template <typename T>
double trilinear(const T* samples, const Index3& count, const Index3& cell,
                 const glm::dvec3& share) {
  double sum = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const Index3 step(corner & 1, corner >> 1 & 1, corner >> 2);
    const double weight = (step.x != 0 ? share.x : 1.0 - share.x) *
                          (step.y != 0 ? share.y : 1.0 - share.y) *
                          (step.z != 0 ? share.z : 1.0 - share.z);
    if (weight != 0.0)
      sum += weight * static_cast<double>(samples[linearIndex(cell + step, count)]);
  }
  return sum;
}

// The slice across `axis` of the voxels at `position`.
IndexPlane slicePlane(const Index3& voxels, int axis, double position);

// The part of the plane dot(normal, world) = offset that the box of the volume's voxels can meet,
// as a square around it; nothing if they do not meet.
std::optional<IndexPlane> capPlane(const Index3& voxels, const GridGeometry& geometry,
                                   const glm::dvec3& normal, double offset);

// Red, green, blue and alpha of each pixel, sRGB and not premultiplied, rows from top to bottom.
struct PictureBytes {
  int width = 0;   // pixels
  int height = 0;  // pixels
  std::vector<std::uint8_t> rgba = {};

  std::size_t offsetOf(int x, int y) const {
    return 4 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                static_cast<std::size_t>(x));
  }
};

// The line where the values of a slice are `isovalue`: there a surface meets the slice.
struct SliceContour {
  double isovalue = 0.0;  // data units
  glm::vec3 color{1.0f};  // sRGB, 0 .. 1

  bool operator==(const SliceContour&) const = default;
};

// Greys from `window`[0], black, to `window`[1], white (data units, sRGB values between them), and
// contours of `width` pixels over them, smooth at their edges and with a dark rim of a pixel. Where
// there is no value the picture is dark. `values`: at least one.
PictureBytes drawSlice(const SliceImage& values, const std::array<double, 2>& window,
                       std::span<const SliceContour> contours, double width);

}  // namespace isobrick
