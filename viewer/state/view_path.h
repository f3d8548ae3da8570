// The views of a turntable, and of a path of the camera from view to view.
#pragma once

#include <vector>

#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// `count` views all around the pivot, to the right, in equal steps from `view` on.
std::vector<ViewState> turntable(const ViewState& view, int count);

// The view a share 0 .. 1 of the way from `a` to `b`: the camera on the shorter way around, its
// distance by equal factors; focus, slices, isovalues, colours and opacities of as many surfaces,
// clip planes if there are as many, backgrounds. All else is that of `a`, before the end.
ViewState viewBetween(const ViewState& a, const ViewState& b, double share);

// `count` views (at least 2) in equal steps from the first of at least two stops to the last.
std::vector<ViewState> viewsAlong(const std::vector<ViewState>& stops, int count);

}  // namespace isobrick
