// Views as pictures.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/image.h"
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

// The scene of a session as a picture with its notes. The rest is as in ViewSession::picture().
Image pictureOf(ViewSession& session, const glm::dvec2& size, int times, bool layers);

// The picture that `isobrick view` shows of this state when it is as fine as it gets: surfaces,
// slices, caps. Throws Error for a damaged brick, sizes that cannot be drawn, and if no OpenGL
// context can be made; and Cancelled.
ViewPicture drawView(std::shared_ptr<const Pyramid> pyramid, const ViewState& state,
                     const ViewDrawing& drawing, const CancelFlag& cancel);
// The same for one view after the other; parts of the surface that stay are made once.
void drawViews(std::shared_ptr<const Pyramid> pyramid, std::span<const ViewState> states,
               const ViewDrawing& drawing, const CancelFlag& cancel,
               const std::function<void(ViewPicture picture)>& take);

}  // namespace isobrick
