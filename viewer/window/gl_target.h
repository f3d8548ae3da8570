// Targets whose frames OpenGL draws: in general, and without a window, for scripts on machines
// without a display.
#pragma once

#include <memory>
#include <optional>

#include "isobrick/viewer/egl_context.h"
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

// Without a window.
class EglTarget : public GlTarget {
 public:
  // Throws Error that says what to install if no context can be made.
  EglTarget(int width, int height, double scale);
  ~EglTarget() override;

  void renew() override;
  std::vector<InputEvent> takeEvents(double wait_seconds) override;
  void resize(int width, int height) override;
  double scale() const override { return scale_; }
  void setTitle(const std::string&) override {}
  void show() override;
  std::string clipboardText() override { return clipboard_; }
  void setClipboardText(const std::string& text) override { clipboard_ = text; }

 private:
  unsigned framebuffer() const override { return *frame_; }

  // In this order: the context goes last.
  std::unique_ptr<EglContext> context_;
  std::optional<EglContext::CurrentScope> current_;
  double scale_;
  int width_, height_;
  GlFramebuffer frame_;
  GlTexture color_;
  std::vector<InputEvent> events_;
  std::string clipboard_;  // of this target alone
};

}  // namespace isobrick
