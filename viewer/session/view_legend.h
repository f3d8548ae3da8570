// The legend of a view.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/viewer/picture_notes.h"
#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// What pictures of `state` have. `levels`: those that are shown; `window`: the values of the
// darkest and the lightest colour, if the surface has values; `path_of`: of its measurements.
PictureNotes notesOf(const ViewState& state, const std::vector<LevelCounts>& levels,
                     const std::optional<std::array<double, 2>>& window, LengthUnit unit,
                     const PathOf& path_of);

}  // namespace isobrick
