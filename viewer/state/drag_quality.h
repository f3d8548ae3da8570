// How fine a surface may be for hands that move, and in which steps it grows fine again.
#pragma once

#include <cstdint>
#include <vector>

namespace isobrick {

// What was measured of the extractions so far. A value; the functions below give the next one.
struct DragQuality {
  double radius = 16.0;               // of interest, voxels: what fits into the time
  double triangles_per_second = 0.0;  // 0: nothing was measured yet
};

// The time that one extraction may take while a slider is dragged.
inline constexpr double kDragSeconds = 0.06;
// No surface is coarser than with this radius.
inline constexpr double kLeastRadius = 8.0;

// After an extraction with `radius`. The surface within a sphere grows with the square of its
// radius, so the radius that fits the time is found from the triangles that fit; steps are bounded,
// since a surface may be anywhere. Runs that found next to nothing leave the rate as it was.
DragQuality measured(const DragQuality& quality, double radius, std::uint64_t triangles,
                     double seconds);

// The radii of the passes at rest: from what is quick, each twice the last one, to `wanted`. Each
// pass makes the whole surface anew, and the geometric growth keeps all of them together to about
// a third more than the last one alone.
std::vector<double> passRadii(double quick, double wanted);

}  // namespace isobrick
