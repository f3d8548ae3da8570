// Timed inputs from a file: they drive a window, or a target without one, in place of the user.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "isobrick/viewer/state/input_event.h"
#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// docs/reference/views-and-scripts.md has the steps as JSON. Each takes a frame at least.
struct ScriptEvent {
  InputEvent event;
};
struct ScriptMotion {  // the cursor from one place to another
  std::array<double, 2> from{}, to{};
  double seconds = 0.0;
};
struct ScriptSweep {  // a slider, moved
  enum class What { kIsovalue, kRadius, kAzimuth } what = What::kIsovalue;
  double from = 0.0, to = 0.0, seconds = 0.0;
};
struct ScriptPatch {  // fields of the state, as a JSON merge patch
  std::string json;
};
struct ScriptWait {
  // For a time; until all is as fine as it gets; until that, or until a preview of the build is
  // shown.
  enum class What { kSeconds, kSettled, kPreview } what = What::kSettled;
  double seconds = 0.0;
};
struct ScriptFile {
  enum class What {
    kFrame,
    kPicture,
    kMesh,
    kShownMesh,
    kMeasurements,
    kState
  } what = What::kFrame;
  std::string name;
};
struct ScriptSize {
  int width = 0, height = 0;
};
struct ScriptLoss {};  // of the graphics card's memory, and its context
using ScriptStep = std::variant<ScriptLoss, ScriptEvent, ScriptMotion, ScriptSweep, ScriptPatch,
                                ScriptWait, ScriptFile, ScriptSize>;

struct ViewScript {
  int width = 1280, height = 800;  // of the picture, pixels
  double scale = 1.0;              // of the interface, without a window; 1 .. kMostScale
  std::vector<ScriptStep> steps;
};

// Throws Error, in one line that names the step, for text that is no script.
ViewScript viewScriptFromJson(const std::string& text);
// The same for a file; Error names the path.
ViewScript readViewScript(const std::string& path);

struct ScriptFrame {
  std::vector<InputEvent> events;
  std::optional<ViewState> state;
  std::optional<ScriptSize> size;
  std::optional<ScriptFile> file;  // after the frame was drawn
  bool lose_context = false;       // before it is drawn
  bool finished = false;           // there is no further step
};

// The last frame: whether it shows the whole state, or a preview of the build, as fine as it gets.
struct ScriptSight {
  bool settled = false;
  bool preview = false;
};

// Plays a script; time is the caller's.
class ScriptPlayer {
 public:
  explicit ScriptPlayer(ViewScript script) : script_(std::move(script)) {}

  const ViewScript& script() const { return script_; }

  // Throws Error if a patch gives no view.
  ScriptFrame next(double seconds, const ScriptSight& sight, const ViewState& state);
  // From a wait for a preview to the next wait nothing may take its place.
  bool keepsPreview() const { return keeps_preview_ && step_ < script_.steps.size(); }

 private:
  bool isDone(const ScriptWait& wait, double elapsed, const ScriptSight& sight) const;
  // True if the step is done with this frame.
  bool play(const ScriptStep& step, double elapsed, const ScriptSight& sight,
            const ViewState& state, ScriptFrame& frame) const;

  ViewScript script_;
  std::size_t step_ = 0;
  std::optional<double> step_begin_;
  bool keeps_preview_ = false;
};

}  // namespace isobrick
