// Pyramids for `isobrick view`, made by `isobrick-build` beside this executable.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "isobrick/viewer/session/volume_opener.h"

namespace isobrick {

struct ViewBuildOptions {
  std::string cache_folder;  // for pyramids; empty: beside the volumes
  int threads = 1;
  std::optional<double> preview_share;  // of a build's time, for previews; nothing: its default
  // Words for `isobrick build` that say how to read this one volume.
  std::string described_volume = {};
  std::vector<std::string> description = {};
};

// Runs `isobrick build` in a process of its own, so that this one needs neither ITK nor OpenVDB. A
// build that was interrupted before goes on; a pyramid of the same input is used, whatever its
// options. Once cancelled, the process has ended when this returns; what is done by then stays, as
// "NAME.isb.partial", for the next time. Previews lie in a folder of their own, in memory where
// there is one for that, which goes with the build.
VolumeBuilder volumeBuilder(ViewBuildOptions options);

}  // namespace isobrick
