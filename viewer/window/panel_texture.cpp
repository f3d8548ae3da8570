#include "isobrick/viewer/window/panel_texture.h"

#include <cstdint>

namespace isobrick {

void PanelTexture::set(const PictureBytes& picture) {
  if (*texture_ == 0) texture_ = GlTexture::make(GL_TEXTURE_2D);
  glBindTexture(GL_TEXTURE_2D, *texture_);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  if (picture.width == width_ && picture.height == height_) {
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width_, height_, GL_RGBA, GL_UNSIGNED_BYTE,
                    picture.rgba.data());
  } else {
    width_ = picture.width;
    height_ = picture.height;
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, width_, height_, 0, GL_RGBA, GL_UNSIGNED_BYTE,
                 picture.rgba.data());
    for (const GLenum side : {GL_TEXTURE_WRAP_S, GL_TEXTURE_WRAP_T})
      glTexParameteri(GL_TEXTURE_2D, side, GL_CLAMP_TO_EDGE);
    for (const GLenum filter : {GL_TEXTURE_MIN_FILTER, GL_TEXTURE_MAG_FILTER})
      glTexParameteri(GL_TEXTURE_2D, filter, GL_LINEAR);
  }
  glBindTexture(GL_TEXTURE_2D, 0);
}

ImTextureID PanelTexture::id() const {
  // ImGui's OpenGL renderer takes the number of a texture for its address.
  return reinterpret_cast<ImTextureID>(static_cast<std::intptr_t>(*texture_));
}

}  // namespace isobrick
