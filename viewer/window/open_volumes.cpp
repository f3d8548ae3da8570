#include "isobrick/viewer/window/open_volumes.h"

#include <algorithm>
#include <filesystem>
#include <glm/geometric.hpp>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/viewer/session/folder_listing.h"

namespace isobrick {

namespace fs = std::filesystem;

bool isOpenedBeside(const std::string& source) {
  if (isRemotePath(source)) return true;
  return source.rfind("phantom:", 0) == 0 ||
         (isPresent(splitHdf5Name(source).first) && !isPyramidFile(source));
}

OpenVolumes::OpenVolumes(const ViewOptions& options, const SessionOptions& sessions,
                         ViewTarget& target, OutputFiles& files)
    : recent_path_(options.recent_path),
      target_(target),
      files_(files),
      recent_(readRecentFiles(options.recent_path)),
      show_(sessions),
      steps_(options.steps, options.steps_open, options.step_names),
      opener_(options.build, options.memory_bytes, options.remote) {}

void OpenVolumes::show(OpenedVolume opened, const glm::dvec2& size) {
  const bool is_preview = opened.preview_of.has_value();
  if (session() == nullptr && steps_.count() > 0 && opened.source == steps_.name(0)) {
    opened.step = 0;
    steps_.keep(opened);
  } else if (!is_preview) {
    steps_.closeAll();
  }
  const std::string source = opened.source, pyramid = opened.pyramid;
  show_.take(std::move(opened), target_.renderer(), size);
  nameAfter(source, is_preview ? " (preview)" : "");
  if (is_preview) return;
  files_.say(source == pyramid ? "" : "the pyramid is " + shortPath(pyramid));
  const bool is_file = isPresent(splitHdf5Name(source).first);  // no phantom
  recent_ = withRecent(std::move(recent_), is_file ? absolutePath(source).string() : source);
  writeRecentFiles(recent_path_, recent_);
}

void OpenVolumes::nameAfter(const std::string& source, const char* what) {
  files_.nameAfter(source, showsStep() ? steps_.name(0) : source);
  target_.setTitle(shownName(fs::path(source).filename().string()) + what + " - isobrick");
}

// The volume under way will not come.
void OpenVolumes::giveUpPreview(const glm::dvec2& size) {
  if (!show_.showsPreview()) return;
  show_.giveUpPreview(target_.renderer(), size);
  if (show_.opened() != nullptr)
    nameAfter(show_.opened()->source, "");
  else
    target_.setTitle("isobrick");
}

bool OpenVolumes::goesOnInTime() const {
  return showsStep() &&
         (session()->interaction().playing || session()->state().step != *opened()->step);
}

// Makes the step that the view asks for or, while they play, the next one, beside the shown one.
void OpenVolumes::goOnInTime(const glm::dvec2& size) {
  if (session() == nullptr) return;
  int& wanted = session()->state().step;
  wanted = std::clamp(wanted, 0, std::max(0, steps() - 1));
  bool& plays = session()->interaction().playing;
  plays = plays && showsStep();
  if (!showsStep() || (busy() && !next_step_)) return;
  const int shown = *opened()->step;
  if (next_step_ == shown) {
    next_step_.reset();
    nameAfter(opened()->source, "");
  }
  std::optional<int> next;
  if (wanted != shown)
    next = wanted;
  else if (plays)
    next = (shown + 1) % steps_.count();
  if (next == next_step_) return;
  next_step_ = next;
  show_.dropNext();
  opener_.cancel();
  if (!next) return;
  error_.clear();
  if (auto open = steps_.find(*next, shown))
    show_.take(std::move(*open), target_.renderer(), size);
  else
    opener_.open(steps_.path(*next));
}

// The shown step stays.
void OpenVolumes::stayInTime() {
  if (!showsStep()) return;
  next_step_.reset();
  show_.dropNext();
  session()->interaction().playing = false;
  session()->state().step = *opened()->step;
}

// With another one, places in voxels, such as that of the region of interest, would not stay.
bool OpenVolumes::hasGridOfSteps(const OpenedVolume& opened) const {
  const PyramidSpec& spec = opened.file->spec();
  const ViewVolume& shown = session()->volume();
  const auto corners = worldCorners(spec.geometry, spec.voxels);
  const auto wanted = worldCorners(shown.geometry, shown.voxels);
  const double rounding = 0.01 * shown.geometry.leastSpacing();
  return spec.voxels == shown.voxels &&
         std::ranges::equal(corners, wanted, [=](const glm::dvec3& a, const glm::dvec3& b) {
           return glm::distance(a, b) <= rounding;
         });
}

void OpenVolumes::take(const glm::dvec2& size, bool keeps_preview,
                       const std::optional<std::string>& is_needed) {
  goOnInTime(size);
  if (!outcome_) outcome_ = opener_.poll();
  if (auto preview = opener_.takePreview()) show(std::move(*preview), size);
  if (keeps_preview && show_.showsPreview()) return;
  auto outcome = std::exchange(outcome_, std::nullopt);
  if (!outcome) return;
  if (!outcome->volume) giveUpPreview(size);
  if (!outcome->volume && session() == nullptr && is_needed == outcome->source)
    throw Error(outcome->error);
  error_ = outcome->error;
  if (!next_step_) {
    if (outcome->volume) show(std::move(*outcome->volume), size);
  } else if (outcome->volume && !hasGridOfSteps(*outcome->volume)) {
    error_ = "'" + steps_.name(*next_step_) +
             "' has another grid than the steps before; open it alone, or make its grid theirs";
    stayInTime();
  } else if (outcome->volume) {
    outcome->volume->source = steps_.name(*next_step_);
    outcome->volume->step = next_step_;
    steps_.keep(*outcome->volume);
    show_.take(std::move(*outcome->volume), target_.renderer(), size);
  } else {
    stayInTime();
  }
}

void OpenVolumes::grant(const Wishes& wishes, const glm::dvec2& size) {
  if (wishes.stop_opening || wishes.open) {
    error_.clear();
    outcome_.reset();
    stayInTime();
  }
  if (wishes.stop_opening) {
    opener_.cancel();
    giveUpPreview(size);
  }
  if (wishes.choose) opener_.choose(*wishes.choose);
  if (wishes.open) opener_.open(*wishes.open);
}

}  // namespace isobrick
