// From the state of a view to the scene of a picture.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "isobrick/viewer/render/scene_frame.h"
#include "isobrick/viewer/state/view_state.h"
#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick {

// A slice or a cap that the view shows.
struct WantedPlane {
  IndexPlane plane;
  int cap_of = -1;  // the clip plane, as it is numbered in the scene
  // The same plane has the same number, wherever it is moved: 0 .. 2 slices, then the view's clip
  // planes.
  int slot = 0;
  int most_values = 0;  // to its longer side, of a sampling that a picture can show
};
// `height`: of the picture, pixels. All voxels are sampled once they have a pixel each, about, up
// to kMostPlaneValues to a side.
inline constexpr int kMostPlaneValues = 2048;
std::vector<WantedPlane> planesOf(const ViewState& state, const ViewVolume& volume, double height);

// All of a frame but the objects that a renderer keeps: chunks, and the images of slices.
SceneFrame sceneOf(const ViewState& state, const ViewVolume& volume, int width, int height);

// The least and the greatest value that surfaces may be coloured by: distances to the plane in the
// volume's box, or `of_vertices`.
std::array<double, 2> valueRangeOf(const ViewState& state, const ViewVolume& volume,
                                   const std::array<double, 2>& of_vertices);
// The values of the first and the last colour, if the view colours by values; `range`: theirs.
std::optional<std::array<double, 2>> valueWindowOf(const ViewState& state,
                                                   const std::array<double, 2>& range);

// The slice of a wanted plane, with the image that a renderer keeps.
SceneSlice sliceOf(const WantedPlane& wanted, SliceId image, const ViewState& state,
                   const ViewVolume& volume);

}  // namespace isobrick
