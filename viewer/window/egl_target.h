// A target without a window: for scripts on machines without a display.
#pragma once

#include <memory>

#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/window/view_target.h"

namespace isobrick {

class EglTarget : public ViewTarget {
 public:
  // Throws Error that says what to install where no context can be made.
  EglTarget(int width, int height, double scale);
  ~EglTarget() override;

  GlSceneRenderer& renderer() override { return *renderer_; }
  std::vector<InputEvent> takeEvents(double wait_seconds) override;
  void resize(int width, int height) override;
  double scale() const override { return scale_; }
  void setTitle(const std::string&) override {}
  unsigned framebuffer() const override { return *frame_; }
  void show() override;

 private:
  EglContext context_;
  EglContext::CurrentScope current_;
  std::unique_ptr<GlSceneRenderer> renderer_;
  double scale_;
  GlFramebuffer frame_;
  GlTexture color_;
  std::vector<InputEvent> events_;
};

}  // namespace isobrick
