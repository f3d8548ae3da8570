// The legend of a view.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/viewer/picture_notes.h"
#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// The pieces of a shown surface that is coloured by them.
struct ColoredPieces {
  double isovalue = 0.0;
  // Their numbers and areas, world units^2; the largest come first.
  std::vector<std::pair<std::size_t, double>> largest;
  std::size_t count = 0;  // of all that are shown
};

// The lines that say which pieces have which colours: one for each colour, which several surfaces
// share.
void addPieces(const std::vector<ColoredPieces>& surfaces, LengthUnit unit, PictureLegend& legend);

// What pictures of `state` have. `levels`: those that are shown; `window`: the values of the
// darkest and the lightest colour, if the surface has values; `pieces`: of surfaces that are
// coloured by them.
PictureNotes notesOf(const ViewState& state, const std::vector<LevelCounts>& levels,
                     const std::optional<std::array<double, 2>>& window, LengthUnit unit,
                     const std::vector<ColoredPieces>& pieces = {});

}  // namespace isobrick
