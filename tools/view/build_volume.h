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
// own, in memory where there is one for that, which goes with the build.
VolumeBuilder volumeBuilder(ViewBuildOptions options);

}  // namespace isobrick
