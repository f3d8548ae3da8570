// A window of the desktop. Only this file and its source use GLFW.
#pragma once

#include <string>
#include <vector>

#include "isobrick/viewer/window/gl_target.h"

struct GLFWwindow;

namespace isobrick {

// One at a time, on the main thread.
class GlWindow : public GlTarget {
 public:
  // Throws Error, with the remedy, if there is no display or no OpenGL 4.5.
  GlWindow(int width, int height, const std::string& title);
  ~GlWindow() override;

  void renew() override;
  std::vector<InputEvent> takeEvents(double wait_seconds) override;
  void resize(int width, int height) override;
  double scale() const override;
  void setTitle(const std::string& title) override;
  void show() override;
  std::string clipboardText() override;
  void setClipboardText(const std::string& text) override;

 private:
  struct Callbacks;
  unsigned framebuffer() const override { return 0; }
  void open(int width, int height);
  void close();
  void pushSize();

  GLFWwindow* window_ = nullptr;
  int last_width_ = 1, last_height_ = 1;  // in the units of the desktop, for another window
  std::string title_;
  std::vector<InputEvent> events_;
};

}  // namespace isobrick
