// `isobrick view`: frames until the window is closed or the script is at its end.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/window/view_target.h"

namespace isobrick {

struct ViewOptions {
  std::string path;                  // a pyramid, or a name that `build` takes; empty: nothing yet
  std::vector<OpenedVolume> beside;  // in the same world
  // Pyramids that are its steps in time, itself the first, as the user named them (empty: by their
  // paths), and how many of them stay open.
  std::vector<std::string> steps, step_names;
  std::size_t steps_open = 2;
  VolumeBuilder build;                 // of a volume that is no pyramid
  std::uint64_t memory_bytes = 0;      // of the file, as Pyramid takes it
  RemoteOptions remote;                // if it is behind a URL
  std::uint64_t gpu_budget_bytes = 0;  // of chunks
  int threads = 1;                     // of the extraction
  ViewRegion region;        // of the volume at `path`, in place of that of the view at `state_path`
  OpenMasks masks;          // of it
  std::string state_path;   // a view to begin with; empty: none
  std::string script_path;  // empty: input comes from the user
  std::string frames_folder = ".";  // where a script's files go
  std::string report_path;          // JSON of a script's timings; empty: none
  std::string recent_path;          // list of the volumes opened last; empty: none
  bool offscreen = false;           // without a window; scripts only
  int width = 1280, height = 800;   // of the window, pixels
  const CancelFlag* cancel = nullptr;
};

// The surroundings of the loop, if they are not a window and a user.
struct ViewHost {
  std::unique_ptr<ViewTarget> target = {};  // null: as the options say
  // After each frame that was shown, or had no room. `session`: null: nothing is open; `settled`:
  // all that was asked for is shown, and written.
  std::function<void(ViewSession* session, bool settled)> after_frame = {};
};

// Throws Error if the file, the view or the script cannot be read, no window can be opened, or a
// script's files cannot be written, and Cancelled. Without a script, errors are shown in the
// window.
void runView(const ViewOptions& options, ViewHost host = {});

}  // namespace isobrick
