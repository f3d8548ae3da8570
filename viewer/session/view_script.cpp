#include "isobrick/viewer/session/view_script.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <tuple>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/nesting.h"
#include "isobrick/viewer/state/interaction.h"
#include "isobrick/viewer/state/view_file.h"

namespace isobrick {
namespace {

using Json = nlohmann::json;

[[noreturn]] void refuse(const std::string& what) { throw Error("the script's " + what); }

double numberOf(const Json& json, const std::string& where) {
  if (!json.is_number()) refuse(where + " is not a number");
  const double number = json.get<double>();
  if (!(std::abs(number) <= 1e9)) refuse(where + " is too large");
  return number;
}

double secondsOf(const Json& json, const std::string& where) {
  const double seconds = numberOf(json, where);
  if (seconds < 0.0) refuse(where + " is below 0");
  return seconds;
}

std::array<double, 2> pairOf(const Json& json, const std::string& where) {
  if (!json.is_array() || json.size() != 2) refuse(where + " is not a list of two numbers");
  return {numberOf(json[0], where), numberOf(json[1], where)};
}

ScriptSize sizeOf(const Json& json, const std::string& where) {
  const auto size = pairOf(json, where);
  constexpr double kMost = 16384;
  if (!(size[0] >= 0 && size[1] >= 0 && size[0] <= kMost && size[1] <= kMost))
    refuse(where + " is not from 0 to 16384");
  return {static_cast<int>(size[0]), static_cast<int>(size[1])};
}

const std::string& textOf(const Json& json, const std::string& where) {
  if (!json.is_string()) refuse(where + " is not a text");
  return json.get_ref<const std::string&>();
}

MouseButton buttonOf(const Json& json, const std::string& where) {
  const std::string& name = textOf(json, where);
  if (name == "left") return MouseButton::kLeft;
  if (name == "middle") return MouseButton::kMiddle;
  if (name == "right") return MouseButton::kRight;
  refuse(where + " is neither 'left', 'middle' nor 'right'");
}

// Names stay in the folder that the caller chose.
std::string fileNameOf(const Json& json, const std::string& where) {
  const std::string& name = textOf(json, where);
  if (name.empty() || name.front() == '.' || name.find('/') != std::string::npos)
    refuse(where + " is not the name of a file");
  return name;
}

// One object of the list as one or more steps.
class StepReader {
 public:
  StepReader(const Json& json, std::size_t number, std::vector<ScriptStep>& steps)
      : json_(json), where_("step " + std::to_string(number)), steps_(steps) {
    if (!json.is_object()) refuse(where_ + " is not an object");
    shift_ = flag("shift");
    control_ = flag("control");
  }

  void read() {
    const std::size_t before = steps_.size();
    for (const auto& [name, value] : json_.items()) {
      if (name == "shift" || name == "control") continue;
      if (steps_.size() != before) refuse(where_ + " is several steps");
      readOne(name, value);
    }
    if (steps_.size() == before) refuse(where_ + " is empty");
  }

 private:
  bool flag(const char* name) const {
    if (!json_.contains(name)) return false;
    if (!json_[name].is_boolean()) refuse(where_ + " '" + name + "' is neither true nor false");
    return json_[name].get<bool>();
  }
  InputEvent event(InputEvent::Kind kind) const {
    InputEvent result;
    result.kind = kind;
    result.shift = shift_;
    result.control = control_;
    return result;
  }
  void move(const std::array<double, 2>& to) {
    InputEvent moved = event(InputEvent::Kind::kMove);
    moved.x = to[0];
    moved.y = to[1];
    steps_.emplace_back(ScriptEvent{moved});
  }
  void button(InputEvent::Kind kind, MouseButton which, int count = 0) {
    InputEvent pressed = event(kind);
    pressed.button = which;
    pressed.clicks = count;
    steps_.emplace_back(ScriptEvent{pressed});
  }
  void clicks(const std::array<double, 2>& at, int count) {
    move(at);
    for (int i = 0; i < count; ++i) {
      button(InputEvent::Kind::kPress, MouseButton::kLeft, i + 1);
      button(InputEvent::Kind::kRelease, MouseButton::kLeft);
    }
  }
  void drag(const Json& value) {
    for (const auto& item : value.items())
      if (item.key() != "from" && item.key() != "to" && item.key() != "button" &&
          item.key() != "seconds")
        refuse(where_ + " 'drag' knows no '" + item.key() + "'");
    if (!value.contains("from") || !value.contains("to"))
      refuse(where_ + " 'drag' lacks 'from' or 'to'");
    const auto from = pairOf(value["from"], where_ + " 'from'");
    const auto to = pairOf(value["to"], where_ + " 'to'");
    const MouseButton which = value.contains("button")
                                  ? buttonOf(value["button"], where_ + " 'button'")
                                  : MouseButton::kLeft;
    move(from);
    button(InputEvent::Kind::kPress, which);
    steps_.emplace_back(ScriptMotion{
        from, to, value.contains("seconds") ? secondsOf(value["seconds"], where_) : 0.5});
    button(InputEvent::Kind::kRelease, which);
  }
  void sweep(const Json& value) {
    ScriptSweep result;
    bool found = false;
    for (const auto& [name, range] : value.items()) {
      if (name == "seconds") {
        result.seconds = secondsOf(range, where_ + " 'seconds'");
        continue;
      }
      if (name == "isovalue")
        result.what = ScriptSweep::What::kIsovalue;
      else if (name == "radius")
        result.what = ScriptSweep::What::kRadius;
      else if (name == "azimuth")
        result.what = ScriptSweep::What::kAzimuth;
      else
        refuse(where_ + " sweeps neither 'isovalue', 'radius' nor 'azimuth'");
      const auto ends = pairOf(range, where_ + " '" + name + "'");
      result.from = ends[0];
      result.to = ends[1];
      found = true;
    }
    if (!found) refuse(where_ + " sweeps nothing");
    steps_.emplace_back(result);
  }
  // All around, in equal steps, a picture each: NAME-0001.png and so on.
  void turntable(const Json& value) {
    for (const auto& item : value.items())
      if (item.key() != "frames" && item.key() != "name")
        refuse(where_ + " 'turntable' knows no '" + item.key() + "'");
    if (!value.contains("frames") || !value["frames"].is_number_integer())
      refuse(where_ + " 'turntable' lacks a whole number of 'frames'");
    const auto frames = value["frames"].get<std::int64_t>();
    if (frames < 1 || frames > 9999) refuse(where_ + " 'frames' is not from 1 to 9999");
    const std::string name =
        value.contains("name") ? fileNameOf(value["name"], where_ + " 'name'") : "turn";
    for (std::int64_t i = 0; i < frames; ++i) {
      const double azimuth = 360.0 * static_cast<double>(i) / static_cast<double>(frames) - 180.0;
      steps_.emplace_back(ScriptPatch{Json{{"camera", {{"azimuth", azimuth}}}}.dump()});
      steps_.emplace_back(ScriptWait{});
      const std::string digits = std::to_string(10000 + i + 1).substr(1);
      steps_.emplace_back(ScriptFile{ScriptFile::What::kPicture, name + "-" + digits + ".png"});
    }
  }
  void keyEvent(const Json& value, InputEvent::Kind kind) {
    const auto which = keyNamed(textOf(value, where_ + " 'key'"));
    if (!which) refuse(where_ + " names no key that is known");
    InputEvent pressed = event(kind);
    pressed.key = *which;
    steps_.emplace_back(ScriptEvent{pressed});
  }
  void typeText(const Json& value, const std::string& where) {
    for (const char character : textOf(value, where)) {
      if (character < ' ' || character > '~') refuse(where + " is not plain ASCII");
      InputEvent typed = event(InputEvent::Kind::kText);
      typed.character = static_cast<unsigned char>(character);
      steps_.emplace_back(ScriptEvent{typed});
    }
  }
  void key(const Json& value) {
    keyEvent(value, InputEvent::Kind::kKeyPress);
    keyEvent(value, InputEvent::Kind::kKeyRelease);
  }

  void wheel(const Json& value, const std::string& where) {
    InputEvent turned = event(InputEvent::Kind::kWheel);
    if (value.is_array()) {
      const auto both = pairOf(value, where);
      turned.amount = both[0];
      turned.across = both[1];
    } else {
      turned.amount = numberOf(value, where);
    }
    steps_.emplace_back(ScriptEvent{turned});
  }

  void wait(const Json& value, const std::string& where) {
    ScriptWait wait;
    if (value == "preview") {
      wait.what = ScriptWait::What::kPreview;
    } else if (value != "settled") {
      wait.what = ScriptWait::What::kSeconds;
      wait.seconds = secondsOf(value, where);
    }
    steps_.emplace_back(wait);
  }

  void open(const Json& value, const std::string& where) {
    InputEvent opened = event(InputEvent::Kind::kOpen);
    opened.path = textOf(value, where);
    if (opened.path.empty()) refuse(where + " is empty");
    steps_.emplace_back(ScriptEvent{opened});
  }

  void readOne(const std::string& name, const Json& value) {
    using Kind = InputEvent::Kind;
    using File = ScriptFile::What;
    const std::string where = where_ + " '" + name + "'";
    const auto file = [&](File what) {
      return [&, what] { steps_.emplace_back(ScriptFile{what, fileNameOf(value, where)}); };
    };
    const bool any = true, object = value.is_object();
    // The names, the values that they may have, and the steps that these are.
    const std::tuple<const char*, bool, std::function<void()>> known[] = {
        {"move", any, [&] { move(pairOf(value, where)); }},
        {"press", any, [&] { button(Kind::kPress, buttonOf(value, where)); }},
        {"release", any, [&] { button(Kind::kRelease, buttonOf(value, where)); }},
        {"click", any, [&] { clicks(pairOf(value, where), 1); }},
        {"double_click", any, [&] { clicks(pairOf(value, where), 2); }},
        {"wheel", any, [&] { wheel(value, where); }},
        {"key", any, [&] { key(value); }},
        {"key_press", any, [&] { keyEvent(value, Kind::kKeyPress); }},
        {"key_release", any, [&] { keyEvent(value, Kind::kKeyRelease); }},
        {"text", any, [&] { typeText(value, where); }},
        {"drag", object, [&] { drag(value); }},
        {"sweep", object, [&] { sweep(value); }},
        {"turntable", object, [&] { turntable(value); }},
        {"set", object, [&] { steps_.emplace_back(ScriptPatch{value.dump()}); }},
        {"open", any, [&] { open(value, where); }},
        {"wait", any, [&] { wait(value, where); }},
        {"lose_context", value == true, [&] { steps_.emplace_back(ScriptLoss{}); }},
        {"resize", any, [&] { steps_.emplace_back(sizeOf(value, where)); }},
        {"frame", any, file(File::kFrame)},
        {"picture", any, file(File::kPicture)},
        {"mesh", any, file(File::kMesh)},
        {"shown_mesh", any, file(File::kShownMesh)},
        {"measurements", any, file(File::kMeasurements)},
        {"state", any, file(File::kState)}};
    for (const auto& [step, fits, read] : known)
      if (fits && name == step) return read();
    refuse(where + " is no step that is known here");
  }

  const Json& json_;
  std::string where_;
  std::vector<ScriptStep>& steps_;
  bool shift_ = false, control_ = false;
};

}  // namespace

ViewScript viewScriptFromJson(const std::string& text) {
  if (nestingDepth(text) > kMostNesting) throw Error("the script is nested more than 16 deep");
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded()) throw Error("the script is not JSON");
  if (!json.is_object() || !json.contains("steps") || !json["steps"].is_array())
    throw Error("the script is not an object with a list 'steps'");
  ViewScript script;
  for (const auto& [name, value] : json.items()) {
    if (name == "size") {
      const ScriptSize size = sizeOf(value, "'size'");
      if (size.width < 1 || size.height < 1) refuse("'size' is not at least 1");
      script.width = size.width;
      script.height = size.height;
    } else if (name == "scale") {
      script.scale = numberOf(value, "'scale'");
      if (!(script.scale >= 1.0 && script.scale <= kMostScale))
        refuse("'scale' is not from 1 to " + Json(kMostScale).dump());
    } else if (name != "steps") {
      refuse("'" + name + "' is not known here");
    }
  }
  std::size_t number = 0;
  for (const Json& step : json["steps"]) StepReader(step, ++number, script.steps).read();
  return script;
}

ViewScript readViewScript(const std::string& path) {
  const std::string text = readTextFile(path, "script");
  try {
    return viewScriptFromJson(text);
  } catch (const Error& error) {
    throw Error(
        "'" + path + "': " + error.what() + "; docs/reference/views-and-scripts.md has the steps",
        {path});
  }
}

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
    // Paths may be no UTF-8, which JSON does not keep.
    if (!changes.contains("values") || !changes["values"].contains("other"))
      frame.state->values.other = state.values.other;
    if (!changes.contains("region")) frame.state->region = state.region;
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
