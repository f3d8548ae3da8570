#include "tools/view/build_volume.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
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

// Volumes in the input, of which --select takes one.
struct OfferedVolumes {
  std::vector<std::string> words, texts;
};

// "progress 0.612 bricks", "preview 4 512 512 234 /dev/shm/1.isb", "choice series=1.2.3 2 'Head'"
void tellLine(std::string_view line, const BuildListener& listener, OfferedVolumes& offered) {
  if (takeWord(line, "progress")) {
    double share = 0.0;
    if (takeNumber(line, share)) listener.progress(line, share);
  } else if (takeWord(line, "preview")) {
    PreviewOf of;
    if (takeNumber(line, of.step) && takeNumber(line, of.voxels.x) &&
        takeNumber(line, of.voxels.y) && takeNumber(line, of.voxels.z))
      listener.preview(std::string(line), of);
  } else if (takeWord(line, "choice")) {
    offered.words.push_back("--select=" + std::string(line.substr(0, line.find(' '))));
    offered.texts.emplace_back(line.substr(std::min(line.size(), line.find(' ') + 1)));
  }
}

}  // namespace

VolumeBuilder volumeBuilder(ViewBuildOptions options) {
  return [options = std::move(options)](const std::string& volume, const BuildListener& listener,
                                        const CancelFlag& cancel) {
    OfferedVolumes offered;
    VolumeBuild build{options.input.cache_folder,
                      {"--threads", std::to_string(options.threads)},
                      [&](std::string_view line) { tellLine(line, listener, offered); }};
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
    try {
      return pyramidOfVolume(volume, build, cancel);
    } catch (const Error& refusal) {
      if (offered.texts.empty()) throw;
      add({offered.words.at(listener.choose(refusal.what(), offered.texts))});
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
