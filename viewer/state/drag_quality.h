// The detail of a surface during a drag, and the steps in which it grows fine again.
#pragma once

#include <cstdint>
#include <vector>

namespace isobrick {

// The measured rates of the extractions so far. A value; the functions below give the next one.
struct DragQuality {
  double radius = 16.0;               // of interest, voxels: fits into the time
  double triangles_per_second = 0.0;  // extracted; 0: nothing was measured yet
  double drawn_per_second = 0.0;      // triangles drawn, by a slow renderer; 0: it is not slow
  double too_large = 0.0;  // a radius of which lately the triangles were too many; 0: none
};

// The time that one extraction, and one picture, may take while a slider is dragged.
inline constexpr double kDragSeconds = 0.06;
// No surface is coarser than with this radius.
inline constexpr double kLeastRadius = 8.0;

// After an extraction with `radius`. The surface within a sphere grows with the square of its
// radius, so the radius that fits the time is found from the triangles that fit; steps are bounded,
// since a surface may be anywhere, and end before a radius that was too large. Runs that found next
// to nothing leave the rate as it was; few triangles may raise it, but do not lower it, as most of
// the time goes into finding them.
DragQuality measured(const DragQuality& quality, double radius, std::uint64_t triangles,
                     double seconds);

// After an extraction with `radius` that was given up for the triangles it had by then. The radius
// is too large until surfaces grow to it again, a little each time.
DragQuality givenUp(const DragQuality& quality, double radius, std::uint64_t triangles,
                    double seconds);

// After a picture of so many triangles. A rasteriser in software is as slow as an extraction.
// Pictures that take less than half the time, as graphics cards draw them, may only raise a rate,
// and remove one that was far lower; few triangles do not lower it either.
DragQuality drawn(const DragQuality& quality, std::uint64_t triangles, double seconds);

// The radius for a user who moves on, while the shown surface has been `age` seconds behind the
// requested one. If frames, or a surface that has suddenly grown, take longer than the stream's
// patience, every extraction is given up for the next one, and none of them gives a rate; so each
// gets smaller than the one before, until one is shown.
double hurriedRadius(double radius, double age);

// Beyond so many triangles a surface for a user who moves is given up for a smaller one: half as
// many again as fit the time, as a surface may suddenly grow; 0 if nothing was measured yet.
std::uint64_t mostTriangles(const DragQuality& quality);

// The radii that replace `radius` if a surface has too many triangles, each half the one before,
// down to a quarter.
std::vector<double> smallerRadii(double radius);

// The radii of the passes at rest: from `quick`, each twice the last one, to `wanted`. Each pass
// makes the bricks anew whose leaves are not those of the one before; even if these are all, the
// geometric growth keeps all passes together to about a third more than the last one.
std::vector<double> passRadii(double quick, double wanted);
// The remaining ones, at least one, if the one with `shown` is shown.
std::vector<double> finerRadii(double shown, double wanted);

}  // namespace isobrick
