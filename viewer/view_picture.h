// Pictures of scenes, drawn tile by tile, and of views.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/notes/draw_notes.h"
#include "isobrick/viewer/picture_notes.h"
#include "isobrick/viewer/picture_writer.h"
#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/session/view_session.h"

namespace isobrick {

// How much of a picture is drawn at once. Small tiles take little memory, and keep a window moving
// that draws between them.
struct TileLimits {
  int most_side = 1024;       // of a tile, pixels
  int most_pixels = 8 << 20;  // of a band, about
};

struct SceneWithNotes {
  SceneFrame frame;     // of all of the picture
  bool layers = false;  // with depth and normals
  PictureNotes notes;
  double target_distance = 1.0;  // from the eye to what a scale bar measures
};

// The width of lines in a picture, in those of a small one: larger pictures have wider ones.
double lineScaleOf(int width, int height);

// Throws Error if a picture has no pixels, or more than kMostPictureSide to a side.
void checkPictureSize(int width, int height);

// Chunks and slices of the frame are kept until the picture is drawn, or given up. Used by the
// thread of the renderer; frames of a window may be drawn between its tiles.
class PictureTiles {
 public:
  // `renderer` outlives it.
  PictureTiles(SceneRenderer& renderer, SceneWithNotes scene, const TileLimits& limits = {});
  ~PictureTiles();
  PictureTiles(const PictureTiles&) = delete;
  PictureTiles& operator=(const PictureTiles&) = delete;

  PictureShape shape() const;
  // Draws the next tile. Returns the rows of a band, with all layers and notes, if it is complete.
  // Throws as SceneRenderer::drawTile().
  std::optional<Image> drawNext();
  bool done() const { return next_.top >= scene_.frame.height; }
  double share() const;

 private:
  void decideInks();
  Image layersOf(const SceneFrame& frame, const PixelBox& tile) const;

  SceneRenderer& renderer_;
  const SceneWithNotes scene_;
  PixelBox next_;  // tile
  int tile_width_ = 1, band_height_ = 1;
  std::optional<NoteInks> inks_;
  Image band_;
};

// Rows that follow those of `picture`, which may have none yet.
void appendRows(const Image& rows, Image& picture);

// All of a small one.
Image drawWhole(SceneRenderer& renderer, SceneWithNotes scene, const TileLimits& limits = {});

// The scene of a session as a picture of this size, with its notes. Surfaces and slices are those
// that it shows.
SceneWithNotes pictureSceneOf(const ViewSession& session, int width, int height, bool layers);

}  // namespace isobrick
