// The target of frames and the source of events: a window, or memory.
#pragma once

#include <string>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/state/input_event.h"

namespace isobrick {

class Clipboard {
 public:
  virtual ~Clipboard() = default;

  // UTF-8; empty if there is no text.
  virtual std::string clipboardText() = 0;
  virtual void setClipboardText(const std::string& text) = 0;
};

// Lives on one thread, on which its context is current all the time.
class ViewTarget : public Clipboard {
 public:
  virtual SceneRenderer& renderer() = 0;
  // Makes another context and renderer in the place of the lost ones; all objects of these are gone
  // by then. Its size comes as an event. Throws Error if there is none; it may be called again.
  virtual void renew() = 0;
  // The events since the last call, the size of the picture first of all; waits for the first event
  // for at most so long.
  virtual std::vector<InputEvent> takeEvents(double wait_seconds) = 0;
  // Requests another size; an event reports it.
  virtual void resize(int width, int height) = 0;
  // How many pixels of this screen are one of an ordinary one.
  virtual double scale() const = 0;
  virtual void setTitle(const std::string& title) = 0;
  // The frame that the renderer drew last becomes a part of the next picture, with its lower left
  // corner at this pixel from the left and from below.
  virtual void present(int left, int bottom) = 0;
  // All of the next picture becomes an empty background.
  virtual void presentNothing(int width, int height) = 0;
  // The picture so far, panels included: 8 bits, sRGB.
  virtual Image screen(int width, int height) = 0;
  virtual void show() = 0;
};

}  // namespace isobrick
