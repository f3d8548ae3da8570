// A saved view as a picture, without a window.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

struct ViewPicture {
  Image image;
  std::uint64_t triangles = 0;
  std::string device;  // the device that drew
};

// The picture that `isobrick view` shows of this state when it is as fine as it gets: surfaces,
// slices, caps. Width and height are pixels; `threads` of the extraction; `layers`: with depth and
// normals. Throws Error for a damaged brick, sizes that cannot be drawn, and if no OpenGL context
// can be made; and Cancelled.
ViewPicture drawView(std::shared_ptr<const Pyramid> pyramid, const ViewState& state, int width,
                     int height, int threads, bool layers, const CancelFlag& cancel);

}  // namespace isobrick
