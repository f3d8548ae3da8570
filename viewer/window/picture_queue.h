// Pictures that are drawn and written beside the window's frames, one after the other.
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "isobrick/viewer/picture_tiles.h"
#include "isobrick/viewer/picture_writer.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_opener.h"

namespace isobrick {

struct PictureOrder {
  OpenedVolume opened;  // shared until its picture is written
  ViewState state;
  int width = 1, height = 1;  // pixels
  std::string path;
  bool must_be = false;  // the program ends if it cannot be written
};

// A picture has surfaces and slices of its own, extracted for its size, beside those of the window,
// so it is the one that `isobrick render --state` draws, whatever the user does meanwhile. A frame
// uploads some of them, or draws a tile; a thread writes. Used by the thread of the renderer.
class PictureQueue {
 public:
  // An order that ended.
  struct Outcome {
    std::string path;
    std::string error;  // empty: the file is there
    bool must_be = false;
  };

  // `options`: of the window's sessions too, with which the pictures share the budget.
  explicit PictureQueue(const SessionOptions& options) : options_(options) {}

  void add(PictureOrder order) { waiting_.push_back(std::move(order)); }
  // For each frame, with its time and what it leaves of its allowance. Returns an order that ended.
  // Throws RendererLost.
  std::optional<Outcome> update(double seconds, SceneRenderer& renderer,
                                UploadAllowance& allowance);
  // Gives back all that the renderer keeps, which may end then; the picture begins again.
  void suspend();

  // Orders that have not ended.
  std::size_t unwritten() const { return waiting_.size(); }
  // The file of the first one.
  const std::string& underWay() const { return waiting_.front().path; }
  // The part of it that is drawn, 0 .. 1.
  double share() const { return tiles_ ? tiles_->share() : writer_ ? 1.0 : 0.0; }
  // True for the file of an order that has not ended.
  bool willWrite(const std::string& path) const;

 private:
  // True if the first order has ended.
  bool goOn(double seconds, SceneRenderer& renderer, UploadAllowance& allowance);
  void end();

  const SessionOptions options_;
  std::deque<PictureOrder> waiting_;  // the first one is under way
  std::unique_ptr<ViewSession> session_;
  std::optional<PictureTiles> tiles_;  // goes before what it draws
  std::unique_ptr<PictureWriter> writer_;
};

}  // namespace isobrick
