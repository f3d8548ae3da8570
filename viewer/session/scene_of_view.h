// From what a view says to what a picture shows.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "isobrick/viewer/render/scene_frame.h"
#include "isobrick/viewer/state/view_state.h"
#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick {

// A slice or a cap that the view wants.
struct WantedPlane {
  IndexPlane plane;
  int cap_of = -1;  // the clip plane, as it is numbered in the scene

  bool operator==(const WantedPlane&) const = default;
};
std::vector<WantedPlane> planesOf(const ViewState& state, const ViewVolume& volume);

// All of a frame but what a renderer keeps: chunks, and the images of slices.
SceneFrame sceneOf(const ViewState& state, const ViewVolume& volume, int width, int height);

// The values of the darkest and the lightest colour, where the view colours by values, of which the
// vertices' are in `range`.
std::optional<std::array<double, 2>> valueWindowOf(const ViewState& state,
                                                   const std::array<double, 2>& range);

// The slice of a wanted plane, with the image that a renderer keeps.
SceneSlice sliceOf(const WantedPlane& wanted, SliceId image, const ViewState& state,
                   const ViewVolume& volume);

}  // namespace isobrick
