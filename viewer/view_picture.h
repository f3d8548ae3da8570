// Views as pictures.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/picture_tiles.h"
#include "isobrick/viewer/picture_writer.h"
#include "isobrick/viewer/session/view_session.h"

namespace isobrick {

struct ViewPicture {
  Image image;
  std::uint64_t triangles = 0;
  std::string device;  // the device that drew
};

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
// The same of one, whole.
ViewPicture drawView(std::shared_ptr<const Pyramid> pyramid, const ViewState& state,
                     const ViewDrawing& drawing, const CancelFlag& cancel);

}  // namespace isobrick
