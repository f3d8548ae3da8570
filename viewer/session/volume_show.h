// The volume that is shown: previews while its pyramid is built, then the pyramid, with the same
// view.
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

  // The session that is shown; null: nothing is open.
  ViewSession* session() const { return shown_ ? shown_->session.get() : nullptr; }
  // The pyramid that it was made of; null likewise.
  const OpenedVolume* opened() const { return shown_ ? &shown_->opened : nullptr; }
  bool showsPreview() const { return shown_ && shown_->opened.preview_of; }

  // A window of `size` pixels, or 0 while there is none, shows it: at once, or, after a preview of
  // the same volume, once it is as fine as it gets, or the user changes the surface.
  void take(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size);
  // No volume will follow the previews: shows again the volume before them.
  void giveUpPreview(SceneRenderer& renderer, const glm::dvec2& size);

  // As those of ViewSession; the shown session and the next one share `allowance`.
  void update(double seconds, UploadAllowance& allowance);
  void suspend();
  void resume(SceneRenderer& renderer);
  // True if nothing is about to replace the shown volume, and that is as fine as it gets.
  bool settled() const { return !next_ && (!shown_ || shown_->session->settled()); }

 private:
  struct Showing {
    OpenedVolume opened;
    std::unique_ptr<ViewSession> session;
  };
  struct Aside {
    OpenedVolume opened;
    ViewState state;
  };
  Showing showingOf(OpenedVolume opened, SceneRenderer& renderer) const;
  void close();
  void open(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size);

  const SessionOptions options_;
  std::optional<Showing> shown_, next_;
  std::optional<Aside> aside_;  // the volume shown before the previews
};

}  // namespace isobrick
