#include "isobrick/viewer/window/picture_queue.h"

#include <algorithm>
#include <utility>

#include "isobrick/viewer/view_picture.h"

namespace isobrick {

bool PictureQueue::willWrite(const std::string& path) const {
  return std::any_of(waiting_.begin(), waiting_.end(),
                     [&](const PictureOrder& order) { return order.path == path; });
}

std::optional<PictureQueue::Outcome> PictureQueue::update(double seconds, SceneRenderer& renderer,
                                                          UploadAllowance& allowance) {
  if (waiting_.empty()) return std::nullopt;
  std::string error;
  try {
    if (!goOn(seconds, renderer, allowance)) return std::nullopt;
  } catch (const RendererLost&) {
    throw;
  } catch (const Error& failure) {
    error = failure.what();
  }
  end();
  const PictureOrder order = std::move(waiting_.front());
  waiting_.pop_front();
  return Outcome{order.path, error, order.must_be};
}

bool PictureQueue::goOn(double seconds, SceneRenderer& renderer, UploadAllowance& allowance) {
  const PictureOrder& order = waiting_.front();
  if (tiles_) {
    if (tiles_->done()) {
      tiles_.reset();
      session_.reset();
    } else if (writer_->hasRoom()) {
      if (auto rows = tiles_->drawNext()) writer_->add(std::move(*rows));
    }
    return false;
  }
  if (writer_) {
    if (!writer_->done()) return false;
    writer_->wait();
    return true;
  }
  if (!session_) {
    SessionOptions options = options_;
    options.preview_of = order.opened.preview_of;
    session_ =
        std::make_unique<ViewSession>(order.opened.file, order.opened.histogram, renderer, options);
    session_->apply(InputEvent::resized(order.width, order.height), seconds, false);
    session_->show(order.state);
  }
  session_->update(seconds, allowance);
  if (!session_->settled()) return false;
  const SessionStatus status = session_->status();
  if (!status.error.empty()) throw Error(status.error);
  if (session_->isOverBudget())
    throw Error(order.path +
                " is not written: its surfaces need more of the graphics card than those of the "
                "window leave; allow more ('isobrick view --gpu-memory SIZE'), or draw it alone "
                "('isobrick render --state')");
  const bool layers = imageFormatOf(order.path) == ImageFormat::kExr;
  tiles_.emplace(renderer, pictureSceneOf(*session_, order.width, order.height, layers));
  writer_ = std::make_unique<PictureWriter>(order.path, tiles_->shape());
  return false;
}

void PictureQueue::end() {
  tiles_.reset();
  session_.reset();
  writer_.reset();
}

void PictureQueue::suspend() {
  if (session_) session_->suspend();
  end();
}

}  // namespace isobrick
