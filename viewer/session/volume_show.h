// Which volume is shown: previews while its pyramid is built, then the pyramid, with the same view.
#pragma once

#include <memory>
#include <optional>

#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_opener.h"

namespace isobrick {

// Belongs to one thread, that of the renderer, which outlives it.
class VolumeShow {
 public:
  explicit VolumeShow(const SessionOptions& options) : options_(options) {}

  // What hands look at; null: nothing is open.
  ViewSession* session() const { return session_.get(); }
  // Of which it was made; null likewise.
  const OpenedVolume* opened() const { return opened_ ? &*opened_ : nullptr; }
  bool showsPreview() const { return opened_ && opened_->preview_of; }

  // A window of `size` pixels, of `scale`, or 0 while there is none, shows it: at once, or, after a
  // preview of the same volume, once it is there as fine as it gets, or what hands do changes the
  // surface.
  void take(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size, double scale);
  // Previews will lead to nothing: what was shown before them is shown again.
  void giveUpPreview(SceneRenderer& renderer, const glm::dvec2& size, double scale);

  // As those of ViewSession; what is shown, and what follows it, share `allowance`.
  void update(double seconds, UploadAllowance& allowance);
  void suspend();
  void resume(SceneRenderer& renderer);
  // Nothing is about to take the place of what is shown, which is as fine as it gets.
  bool settled() const { return !next_ && (!session_ || session_->settled()); }

 private:
  struct Aside {
    OpenedVolume opened;
    ViewState state;
  };
  std::unique_ptr<ViewSession> makeSession(const OpenedVolume& opened,
                                           SceneRenderer& renderer) const;
  void open(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size, double scale);

  const SessionOptions options_;
  std::unique_ptr<ViewSession> session_, next_;
  std::optional<OpenedVolume> opened_, next_opened_;
  std::optional<Aside> aside_;  // what was shown before previews
};

}  // namespace isobrick
