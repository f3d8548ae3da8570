// The volumes of the window: the one that is shown, and the one that is being opened.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "isobrick/viewer/session/time_steps.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/window/output_files.h"
#include "isobrick/viewer/window/view_loop.h"
#include "isobrick/viewer/window/view_target.h"

namespace isobrick {

// A file or a folder that is there and is no pyramid, the name of a phantom, or a URL: opening it
// takes time, and may build. Everything else is a pyramid, or an error, at once.
bool isOpenedBeside(const std::string& source);

// The old volume stays until the new one, or its first preview, is there.
class OpenVolumes {
 public:
  // All of them outlive it. `files` and the title of `target` are named after what is shown.
  OpenVolumes(const ViewOptions& options, const SessionOptions& sessions, ViewTarget& target,
              OutputFiles& files);

  void open(const std::string& source) { opener_.open(source); }
  // Replaces the volume shown before, in a window of `size` pixels.
  void show(OpenedVolume opened, const glm::dvec2& size);
  // For each frame: shows what was opened since. With `keeps_preview` only another preview replaces
  // a preview. Throws Error if `is_needed` (a path) cannot be opened and nothing is shown.
  void take(const glm::dvec2& size, bool keeps_preview,
            const std::optional<std::string>& is_needed);
  void grant(const Wishes& wishes, const glm::dvec2& size);

  VolumeShow& shown() { return show_; }
  const VolumeShow& shown() const { return show_; }
  ViewSession* session() const { return show_.session(); }
  const OpenedVolume* opened() const { return show_.opened(); }
  bool showsPreview() const { return show_.showsPreview(); }
  // All that was opened is shown, as fine as it gets. Of steps that play, the shown one is.
  bool settled() const {
    const bool plays = next_step_ && showsStep() && session()->interaction().playing;
    if (plays) return session()->settled() && session()->state().step == *opened()->step;
    return (!busy() || asks()) && !outcome_ && show_.settled() && !goesOnInTime();
  }
  // Another step than the shown one is chosen, or they play.
  bool goesOnInTime() const;
  // Of time, of which one is shown; 0: there are none.
  int steps() const { return showsStep() ? steps_.count() : 0; }
  bool busy() const { return opener_.status().busy; }
  // The user is to choose from several volumes in what is being opened.
  bool asks() const { return !opener_.status().choices.empty(); }

  // Nothing of steps that play: they are opened all the time.
  VolumeOpener::Status status() const {
    const bool plays = session() != nullptr && session()->interaction().playing;
    return plays ? VolumeOpener::Status{} : opener_.status();
  }
  // Why the last opening ended without a volume; empty: it did not.
  const std::string& error() const { return error_; }
  // Opened last, latest first.
  const std::vector<std::string>& recent() const { return recent_; }

 private:
  void nameAfter(const std::string& source, const char* what);
  void giveUpPreview(const glm::dvec2& size);
  bool showsStep() const { return opened() != nullptr && opened()->step; }
  void goOnInTime(const glm::dvec2& size);
  void stayInTime();
  bool hasGridOfSteps(const OpenedVolume& opened) const;

  const std::string recent_path_;
  ViewTarget& target_;
  OutputFiles& files_;
  std::vector<std::string> recent_;
  std::string error_;
  VolumeShow show_;
  TimeSteps steps_;
  std::optional<int> next_step_;  // that is opened, or made beside the shown one
  VolumeOpener opener_;           // its end waits for that of a build
  std::optional<VolumeOpener::Outcome> outcome_;
};

}  // namespace isobrick
