#include "tools/view/build_volume.h"

#include <fmt/format.h>

#include <string_view>
#include <utility>

#include "tools/line_words.h"
#include "tools/view/preview_folder.h"

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
                      {"--any-options", "--threads", std::to_string(options.threads)},
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

}  // namespace isobrick
