// The viewer's window within a test, without a display.
#pragma once

#include <cstdint>

#include "isobrick/viewer/window/view_loop.h"
#include "tests/support/field_pyramid.h"

namespace isobrick::test {

// On a ball of 15 voxels; the script is `script.json`, and all files go into the folder.
inline ViewOptions offscreenView(const TemporaryFolder& folder) {
  BuildOptions build;
  build.brick_cells = 16;
  ViewOptions options;
  options.path = buildField(
      folder, Index3(40),
      [](const glm::dvec3& p) { return 15.0 - glm::distance(p, glm::dvec3(20.0)); }, build);
  options.memory_bytes = std::uint64_t{64} << 20;
  options.gpu_budget_bytes = std::uint64_t{64} << 20;
  options.offscreen = true;
  options.frames_folder = folder.path();
  options.script_path = folder.file("script.json");
  return options;
}

}  // namespace isobrick::test
