// Plays the steps of a script, frame by frame.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/state/view_state_json.h"

namespace isobrick {

ScriptFrame ScriptPlayer::next(double seconds, const ScriptSight& sight, const ViewState& state) {
  ScriptFrame frame;
  if (step_ < script_.steps.size()) {
    if (!step_begin_) step_begin_ = seconds;
    if (const auto* wait = std::get_if<ScriptWait>(&script_.steps[step_]))
      keeps_preview_ = wait->what == ScriptWait::What::kPreview;
    if (play(script_.steps[step_], seconds - *step_begin_, sight, state, frame)) {
      ++step_;
      step_begin_.reset();
    }
  }
  frame.finished = step_ == script_.steps.size();
  return frame;
}

bool ScriptPlayer::isDone(const ScriptWait& wait, double elapsed, const ScriptSight& sight) const {
  switch (wait.what) {
    case ScriptWait::What::kSeconds:
      return elapsed >= wait.seconds;
    case ScriptWait::What::kSettled:
      return sight.settled;
    case ScriptWait::What::kPreview:
      return sight.settled || sight.preview;
  }
  return true;
}

bool ScriptPlayer::play(const ScriptStep& step, double elapsed, const ScriptSight& sight,
                        const ViewState& state, ScriptFrame& frame) const {
  const auto shareOf = [&](double seconds) {
    return seconds > 0.0 ? std::clamp(elapsed / seconds, 0.0, 1.0) : 1.0;
  };
  if (const auto* event = std::get_if<ScriptEvent>(&step)) {
    frame.events.push_back(event->event);
  } else if (const auto* motion = std::get_if<ScriptMotion>(&step)) {
    const double share = shareOf(motion->seconds);
    InputEvent moved;
    moved.x = motion->from[0] + share * (motion->to[0] - motion->from[0]);
    moved.y = motion->from[1] + share * (motion->to[1] - motion->from[1]);
    frame.events.push_back(moved);
    return share >= 1.0;
  } else if (const auto* sweep = std::get_if<ScriptSweep>(&step)) {
    const double share = shareOf(sweep->seconds);
    const double value = sweep->from + share * (sweep->to - sweep->from);
    frame.state = state;
    if (sweep->what == ScriptSweep::What::kIsovalue) {
      activeSurface(*frame.state).isovalue = value;
    } else if (sweep->what == ScriptSweep::What::kRadius) {
      frame.state->focus.radius = value;
      frame.state->focus.everywhere = false;
    } else {
      frame.state->camera.azimuth = value;
    }
    return share >= 1.0;
  } else if (const auto* patch = std::get_if<ScriptPatch>(&step)) {
    nlohmann::json json = nlohmann::json::parse(viewStateToJson(state));
    const nlohmann::json changes = nlohmann::json::parse(patch->json);
    json.merge_patch(changes);
    frame.state = viewStateFromJson(json.dump());
    // The path may be no UTF-8, which JSON does not keep.
    if (!changes.contains("values") || !changes["values"].contains("other"))
      frame.state->values.other = state.values.other;
  } else if (const auto* wait = std::get_if<ScriptWait>(&step)) {
    return isDone(*wait, elapsed, sight);
  } else if (const auto* file = std::get_if<ScriptFile>(&step)) {
    frame.file = *file;
  } else if (const auto* size = std::get_if<ScriptSize>(&step)) {
    frame.size = *size;
  } else if (std::holds_alternative<ScriptLoss>(step)) {
    frame.lose_context = true;
  }
  return true;
}

}  // namespace isobrick
