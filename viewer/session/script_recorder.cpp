// The user's input as the steps of a script.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/state/interaction.h"

namespace isobrick {
namespace {

using Json = nlohmann::json;

const char* nameOf(MouseButton button) {
  return button == MouseButton::kLeft     ? "left"
         : button == MouseButton::kMiddle ? "middle"
                                          : "right";
}

// The step that an event is; null if it is none.
Json stepOf(const InputEvent& event) {
  Json step;
  switch (event.kind) {
    case InputEvent::Kind::kMove:
      step["move"] = {event.x, event.y};
      break;
    case InputEvent::Kind::kPress:
      step["press"] = nameOf(event.button);
      break;
    case InputEvent::Kind::kRelease:
      step["release"] = nameOf(event.button);
      break;
    case InputEvent::Kind::kWheel:
      step["wheel"] = event.amount;
      if (event.across != 0.0) step["wheel"] = {event.amount, event.across};
      break;
    case InputEvent::Kind::kKeyPress:
      step["key_press"] = kKeyNames[static_cast<std::size_t>(event.key)];
      break;
    case InputEvent::Kind::kKeyRelease:
      step["key_release"] = kKeyNames[static_cast<std::size_t>(event.key)];
      break;
    case InputEvent::Kind::kText:
      if (event.character >= ' ' && event.character <= '~')
        step["text"] = std::string(1, static_cast<char>(event.character));
      break;
    case InputEvent::Kind::kResize:
      step["resize"] = {event.x, event.y};
      break;
    case InputEvent::Kind::kOpen:
      step["open"] = event.path;
      break;
    case InputEvent::Kind::kClose:
    case InputEvent::Kind::kRefresh:
      break;
  }
  if (step.is_null()) return step;
  if (event.shift) step["shift"] = true;
  if (event.control) step["control"] = true;
  return step;
}

}  // namespace

std::string ScriptRecorder::head(int width, int height, double scale) {
  return "{\"size\": [" + std::to_string(width) + ", " + std::to_string(height) +
         "], \"scale\": " + Json(std::clamp(scale, 1.0, kMostScale)).dump() + ", \"steps\": [";
}

std::string ScriptRecorder::add(double seconds, const InputEvent& event) {
  const Json step = stepOf(event);
  if (step.is_null()) return {};
  std::string text;
  const auto append = [&](const std::string& json) {
    text += (std::exchange(is_empty_, false) ? "\n  " : ",\n  ") + json;
  };
  constexpr double kShortest = 0.02;  // about a frame, which a step takes anyway
  if (last_ && seconds - *last_ > kShortest) {
    const double wait = std::round(1e3 * (seconds - *last_)) / 1e3;
    append(Json{{"wait", wait}}.dump());
  }
  last_ = seconds;
  // A path may be no UTF-8, but JSON is always UTF-8.
  append(step.dump(-1, ' ', false, Json::error_handler_t::replace));
  return text;
}

}  // namespace isobrick
