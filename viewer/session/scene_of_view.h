// From the state of a view to the scene of a picture, and to its notes.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/viewer/picture_notes.h"
#include "isobrick/viewer/render/scene_renderer.h"
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

std::vector<PictureMark> marksOf(const ViewState& state, LengthUnit unit);

// What pictures of `state` have. `levels`: those that are shown; `window`: the values of the
// darkest and the lightest colour, if the surface has values; `pieces`: of surfaces that are
// coloured by them.
PictureNotes notesOf(const ViewState& state, const std::vector<LevelCounts>& levels,
                     const std::optional<std::array<double, 2>>& window, LengthUnit unit,
                     const std::vector<ColoredPieces>& pieces = {});

}  // namespace isobrick
