#include "isobrick/viewer/session/volume_show.h"

#include <utility>

namespace isobrick {

VolumeShow::Showing VolumeShow::showingOf(OpenedVolume opened, SceneRenderer& renderer) const {
  SessionOptions options = options_;
  options.preview_of = opened.preview_of;
  auto session = std::make_unique<ViewSession>(opened.file, opened.histogram, renderer, options);
  return {std::move(opened), std::move(session)};
}

void VolumeShow::close() {
  next_.reset();
  shown_.reset();
}

void VolumeShow::open(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size) {
  const bool with_panel = !shown_ || session()->interaction().show_panel;
  close();
  shown_ = showingOf(std::move(opened), renderer);
  session()->interaction().show_panel = with_panel;
  if (!(size.y > 0.0)) return;
  session()->apply(InputEvent::resized(size.x, size.y), 0.0, false);
}

void VolumeShow::take(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size) {
  if (showsPreview() && opened.source == shown_->opened.source) {
    next_ = showingOf(std::move(opened), renderer);
    return;
  }
  if (!opened.preview_of)
    aside_.reset();
  else if (shown_ && !showsPreview())
    aside_ = Aside{shown_->opened, session()->state()};
  open(std::move(opened), renderer, size);
}

void VolumeShow::giveUpPreview(SceneRenderer& renderer, const glm::dvec2& size) {
  if (!showsPreview()) return;
  if (!aside_) return close();
  Aside before = *std::exchange(aside_, std::nullopt);
  open(std::move(before.opened), renderer, size);
  session()->show(before.state);
}

void VolumeShow::update(double seconds, UploadAllowance& allowance) {
  if (!shown_) return;
  session()->update(seconds, allowance);
  if (!next_) return;
  next_->session->follow(*session());
  next_->session->update(seconds, allowance);
  const bool takes_over =
      next_->session->isFine() || (next_->session->hasShown() && !session()->settled());
  if (!takes_over) return;
  shown_ = std::exchange(next_, std::nullopt);
  if (!showsPreview()) aside_.reset();
}

void VolumeShow::suspend() {
  if (shown_) session()->suspend();
  if (next_) next_->session->suspend();
}

void VolumeShow::resume(SceneRenderer& renderer) {
  if (shown_) session()->resume(renderer);
  if (next_) next_->session->resume(renderer);
}

}  // namespace isobrick
