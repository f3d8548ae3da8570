// A picture on the graphics card, for ImGui::Image().
#pragma once

#include <imgui.h>

#include "isobrick/viewer/picture_bytes.h"
#include "isobrick/viewer/render/gl_handle.h"

namespace isobrick {

// One at a time on the thread of the current context, which outlives it.
class PanelTexture {
 public:
  // The pixels of a picture that has at least one. Its size may change from call to call.
  void set(const PictureBytes& picture);
  ImTextureID id() const;
  bool isEmpty() const { return width_ == 0; }

 private:
  GlTexture texture_;
  int width_ = 0, height_ = 0;
};

}  // namespace isobrick
