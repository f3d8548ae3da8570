#include "tools/view/build_volume.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <utility>

#include "isobrick/storage/file_system.h"
#include "tools/plain_text.h"

namespace isobrick {
namespace {

// "progress 0.612 bricks", "preview 4 512 512 234 /dev/shm/1.isb"
void tellLine(std::string_view line, const BuildListener& listener) {
  if (takeWord(line, "progress")) {
    double share = 0.0;
    if (takeNumber(line, share)) listener.progress(line, share);
  } else if (takeWord(line, "preview")) {
    PreviewOf of;
    if (takeNumber(line, of.step) && takeNumber(line, of.voxels.x) &&
        takeNumber(line, of.voxels.y) && takeNumber(line, of.voxels.z))
      listener.preview(std::string(line), of);
  }
}

}  // namespace

VolumeBuilder volumeBuilder(ViewBuildOptions options) {
  return [options = std::move(options)](const std::string& volume, const BuildListener& listener,
                                        const CancelFlag& cancel) {
    VolumeBuild build{options.input.cache_folder,
                      {"--threads", std::to_string(options.threads)},
                      [&](std::string_view line) { tellLine(line, listener); }};
    const auto add = [&](const std::vector<std::string>& words) {
      build.words.insert(build.words.end(), words.begin(), words.end());
    };
    if (volume == options.input.path) add(wordsForBuild(options.input));
    const PreviewFolder previews;
    if (!previews.path().empty()) {
      add({"--preview-folder", previews.path()});
      if (options.preview_share)
        add({"--preview-share", fmt::format("{}", *options.preview_share)});
    }
    return pyramidOfVolume(volume, build, cancel);
  };
}

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPreviewFolderName = "isobrick-preview-";

fs::path placeForPreviews() {
  const char* const of_session = std::getenv("XDG_RUNTIME_DIR");
  for (const char* const place : {of_session, "/dev/shm"})
    if (place != nullptr && place[0] == '/' && access(place, W_OK | X_OK) == 0) return place;
  return temporaryFolder();
}

bool isOfLivingProcess(std::string_view name) {
  name.remove_prefix(kPreviewFolderName.size());
  pid_t process = 0;
  const auto read = std::from_chars(name.data(), name.data() + name.size(), process);
  return read.ec != std::errc() || process <= 0 || kill(process, 0) == 0 || errno != ESRCH;
}

// A file of another user cannot be removed.
void removeLeftPreviews(const fs::path& place) {
  visitFolder(place, [](const FolderMember& member) {
    const std::string name = member.name();
    if (name.rfind(kPreviewFolderName, 0) == 0 && !isOfLivingProcess(name))
      removeTree(member.path());
    return true;
  });
}

}  // namespace

PreviewFolder::PreviewFolder() {
  const fs::path place = placeForPreviews();
  removeLeftPreviews(place);
  std::string name = (place / fmt::format("{}{}-XXXXXX", kPreviewFolderName, getpid())).string();
  if (mkdtemp(name.data()) != nullptr) path_ = name;
}

PreviewFolder::~PreviewFolder() {
  if (!path_.empty()) removeTree(path_);
}

}  // namespace isobrick
