#include "isobrick/viewer/session/volume_show.h"

#include <utility>

namespace isobrick {

std::unique_ptr<ViewSession> VolumeShow::makeSession(const OpenedVolume& opened,
                                                     SceneRenderer& renderer) const {
  SessionOptions options = options_;
  options.preview_of = opened.preview_of;
  return std::make_unique<ViewSession>(opened.file, opened.histogram, renderer, options);
}

void VolumeShow::open(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size,
                      double scale) {
  const bool with_panel = !session_ || session_->interaction().show_panel;
  next_.reset();
  next_opened_.reset();
  session_.reset();
  session_ = makeSession(opened, renderer);
  opened_ = std::move(opened);
  session_->interaction().show_panel = with_panel;
  session_->interaction().scale = scale;
  if (!(size.y > 0.0)) return;
  InputEvent resized;
  resized.kind = InputEvent::Kind::kResize;
  resized.x = size.x;
  resized.y = size.y;
  session_->apply(resized, 0.0, false);
}

void VolumeShow::take(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size,
                      double scale) {
  if (showsPreview() && opened.source == opened_->source) {
    next_ = makeSession(opened, renderer);
    next_opened_ = std::move(opened);
    return;
  }
  if (!opened.preview_of)
    aside_.reset();
  else if (session_ && !showsPreview())
    aside_ = Aside{*opened_, session_->state()};
  open(std::move(opened), renderer, size, scale);
}

void VolumeShow::giveUpPreview(SceneRenderer& renderer, const glm::dvec2& size, double scale) {
  if (!showsPreview()) return;
  if (aside_) {
    Aside before = *std::exchange(aside_, std::nullopt);
    open(std::move(before.opened), renderer, size, scale);
    session_->state() = before.state;
    return;
  }
  next_.reset();
  next_opened_.reset();
  session_.reset();
  opened_.reset();
}

void VolumeShow::update(double seconds, UploadAllowance& allowance) {
  if (!session_) return;
  session_->update(seconds, allowance);
  if (!next_) return;
  next_->follow(*session_);
  next_->update(seconds, allowance);
  const bool takes_over = next_->settled() || (next_->hasShown() && !session_->settled());
  if (!takes_over || session_->writesMesh()) return;
  session_ = std::move(next_);
  opened_ = std::exchange(next_opened_, std::nullopt);
  if (!showsPreview()) aside_.reset();
}

void VolumeShow::suspend() {
  if (session_) session_->suspend();
  if (next_) next_->suspend();
}

void VolumeShow::resume(SceneRenderer& renderer) {
  if (session_) session_->resume(renderer);
  if (next_) next_->resume(renderer);
}

}  // namespace isobrick
