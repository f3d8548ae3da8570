// Pictures of scenes, drawn tile by tile, and of views.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
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

// How views are drawn: width and height are pixels, `threads` are those of the extraction, with
// `layers` pictures have depth and normals.
struct ViewDrawing {
  int width = 1;
  int height = 1;
  int threads = 1;
  bool layers = false;
};

// The scene of a session as a picture of this size, with its notes. Surfaces and slices are those
// that it shows.
SceneWithNotes pictureSceneOf(const ViewSession& session, int width, int height, bool layers);

// Some rows of the picture of a view, from top to bottom, whose size need not fit into memory.
struct ViewRows {
  std::size_t picture = 0;  // of the view with this number
  PictureShape shape;       // of all of it
  Image rows;
  double share = 1.0;           // of the picture that is drawn, 0 .. 1
  std::uint64_t triangles = 0;  // of the surface
  std::string device;           // the device that draws
};

// Draws the pictures that `isobrick view` shows of these states when they are as fine as they get:
// surfaces, slices, caps; parts of a surface that stay from one to the next are made once. Throws
// Error for a damaged brick, sizes that cannot be drawn, and if no OpenGL context can be made; and
// Cancelled.
void drawViews(std::shared_ptr<const Pyramid> pyramid, std::span<const ViewState> states,
               const ViewDrawing& drawing, const CancelFlag& cancel,
               const std::function<void(ViewRows rows)>& take);

}  // namespace isobrick
