// A target whose frames OpenGL draws.
#pragma once

#include <memory>

#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "isobrick/viewer/window/view_target.h"

namespace isobrick {

class GlTarget : public ViewTarget {
 public:
  SceneRenderer& renderer() override { return *renderer_; }
  void present(int left, int bottom) override;
  void presentNothing(int width, int height) override;
  Image screen(int width, int height) override;

 protected:
  // The one that is shown, of the current context.
  virtual unsigned framebuffer() const = 0;

  std::unique_ptr<GlSceneRenderer> renderer_;  // goes before its context
};

}  // namespace isobrick
