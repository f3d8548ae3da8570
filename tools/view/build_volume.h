// Pyramids for `isobrick view`, with previews while they are built.
#pragma once

#include <optional>
#include <string>

#include "isobrick/viewer/session/volume_opener.h"
#include "tools/volume_input.h"

namespace isobrick {

struct ViewBuildOptions {
  VolumeInput input;  // the folder of the cache; and how to read the volume of this path
  int threads = 1;
  std::optional<double> preview_share;  // of a build's time, for previews; nothing: its default
};

// Builds into the cache, or finds there (tools/volume_input.h). Previews lie in a folder of their
// own, in memory if there is such a place; the folder is removed after the build.
VolumeBuilder volumeBuilder(ViewBuildOptions options);

// In memory if there is a place for that; for this user alone. It is removed, with all in it, with
// the object; the folder of a killed process when the next one is made.
class PreviewFolder {
 public:
  PreviewFolder();
  ~PreviewFolder();
  PreviewFolder(const PreviewFolder&) = delete;
  PreviewFolder& operator=(const PreviewFolder&) = delete;

  const std::string& path() const { return path_; }  // empty: it could not be made

 private:
  std::string path_;
};

}  // namespace isobrick
