// Scripts: what is one, and what their steps do to frames.
#include "isobrick/viewer/session/view_script.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_paths.h"

namespace isobrick {
namespace {

using Kind = InputEvent::Kind;

std::string refusal(const std::string& text) {
  try {
    viewScriptFromJson(text);
  } catch (const Error& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ViewScriptTest, TheRefusalNamesThePageThatHasTheSteps) {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("bad.json");
  std::ofstream(path) << R"({"steps": [{"jump": 1}]})";
  std::string said;
  try {
    readViewScript(path);
  } catch (const Error& error) {
    said = error.what();
  }
  const std::size_t begin = said.find("docs/"), end = said.find(' ', begin);
  ASSERT_NE(begin, std::string::npos) << said;
  const std::string page =
      test::readBytes(test::goldenFolder() + "/../../" + said.substr(begin, end - begin));
  for (const char* step : {"\"double_click\"", "\"sweep\"", "\"turntable\"", "\"resize\""})
    EXPECT_NE(page.find(step), std::string::npos) << said;
}

TEST(ViewScriptTest, WhatIsNoScriptIsRefusedByItsStep) {
  EXPECT_EQ(refusal("["), "the script is not JSON");
  EXPECT_EQ(refusal("{}"), "the script is not an object with a list 'steps'");
  EXPECT_EQ(refusal(R"({"steps": [], "width": 3})"), "the script's 'width' is not known here");
  const std::pair<const char*, const char*> cases[] = {
      {R"([3])", "step 1 is not an object"},
      {R"([{"wait": 1}, {}])", "step 2 is empty"},
      {R"([{"wait": 1, "key": "F"}])", "step 1 is several steps"},
      {R"([{"jump": 1}])", "step 1 'jump' is no step"},
      {R"([{"move": [1]}])", "step 1 'move' is not a list of two"},
      {R"([{"move": [1, "x"]}])", "step 1 'move' is not a number"},
      {R"([{"press": "top"}])", "step 1 'press' is neither"},
      {R"([{"lose_context": false}])", "step 1 'lose_context' is no step"},
      {R"([{"key": "f"}])", "step 1 names no key"},
      {R"([{"wait": -1}])", "step 1 'wait' is below 0"},
      {R"([{"wait": "long"}])", "step 1 'wait' is not a number"},
      {R"([{"drag": {"from": [0, 0]}}])", "step 1 'drag' lacks"},
      {R"([{"drag": {"from": [0, 0], "to": [1, 1], "speed": 3}}])",
       "step 1 'drag' knows no 'speed'"},
      {R"([{"sweep": {"seconds": 3}}])", "step 1 sweeps nothing"},
      {R"([{"sweep": {"height": [1, 2]}}])", "step 1 sweeps neither"},
      {R"([{"turntable": {"name": "a"}}])", "step 1 'turntable' lacks"},
      {R"([{"turntable": {"frames": 0}}])", "step 1 'frames' is not from 1"},
      {R"([{"turntable": {"frames": 2, "speed": 1}}])", "step 1 'turntable' knows no 'speed'"},
      {R"([{"frame": "../a.png"}])", "step 1 'frame' is not the name of a file"},
      {R"([{"mesh": "a/b.ply"}])", "step 1 'mesh' is not the name of a file"},
      {R"([{"open": ""}])", "step 1 'open' is empty"},
      {R"([{"open": 3}])", "step 1 'open' is not a text"},
      {R"([{"resize": [-1, 5]}])", "step 1 'resize' is not from 0"},
      {R"([{"wheel": 1, "shift": 1}])", "step 1 'shift' is neither true"},
  };
  for (const auto& [steps, message] : cases) {
    const std::string said = refusal(std::string(R"({"steps": )") + steps + "}");
    EXPECT_NE(said.find(message), std::string::npos) << said;
  }
}

TEST(ViewScriptTest, StepsComeOneAFrameAndInTime) {
  ScriptPlayer player(viewScriptFromJson(R"({"size": [640, 480], "steps": [
      {"click": [10, 20]},
      {"drag": {"from": [0, 0], "to": [100, 50], "button": "middle", "seconds": 1}},
      {"wait": 0.5},
      {"wait": "settled"},
      {"key": "W", "shift": true},
      {"frame": "a.png"}]})"));
  ViewState state;
  const auto next = [&](double seconds, bool settled = false) {
    return player.next(seconds, {settled}, state);
  };
  const auto kindOf = [](const ScriptFrame& frame) {
    return frame.events.size() == 1 ? frame.events[0].kind : Kind::kText;
  };
  EXPECT_EQ(kindOf(next(0.0)), Kind::kMove);
  EXPECT_EQ(kindOf(next(0.1)), Kind::kPress);
  EXPECT_EQ(kindOf(next(0.2)), Kind::kRelease);
  EXPECT_EQ(kindOf(next(0.3)), Kind::kMove);
  const ScriptFrame press = next(0.4);
  EXPECT_EQ(kindOf(press), Kind::kPress);
  EXPECT_EQ(press.events[0].button, MouseButton::kMiddle);
  EXPECT_EQ(next(1.0).events[0].x, 0.0);
  EXPECT_DOUBLE_EQ(next(1.25).events[0].x, 25.0);
  EXPECT_EQ(next(2.5).events[0].y, 50.0);  // its end, however late
  EXPECT_EQ(kindOf(next(2.6)), Kind::kRelease);
  EXPECT_TRUE(next(3.0).events.empty());
  EXPECT_TRUE(next(3.4).events.empty());
  EXPECT_TRUE(next(3.6).events.empty());  // the wait is over
  EXPECT_TRUE(next(3.7, false).events.empty());
  EXPECT_TRUE(next(9.0, false).events.empty());
  EXPECT_TRUE(next(9.1, true).events.empty());
  const ScriptFrame key = next(9.2);
  EXPECT_EQ(key.events[0].key, Key::kW);
  EXPECT_TRUE(key.events[0].shift);
  EXPECT_EQ(kindOf(next(9.3)), Kind::kKeyRelease);
  const ScriptFrame last = next(9.4);
  ASSERT_TRUE(last.file);
  EXPECT_EQ(last.file->name, "a.png");
  EXPECT_TRUE(last.finished);
}

TEST(ViewScriptTest, StepsAreTheEventsThatTheyName) {
  const ViewScript script = viewScriptFromJson(R"({"size": [300, 200], "scale": 1.75, "steps": [
      {"move": [12.25, 40]}, {"press": "right", "shift": true}, {"wheel": [-2, 0.5]},
      {"key_press": "PAD7", "control": true}, {"text": "\""}, {"resize": [5, 6]},
      {"open": "/scans/head \"1\".nrrd"}, {"wait": 0.25}]})");
  EXPECT_EQ(script.width, 300);
  EXPECT_EQ(script.height, 200);
  EXPECT_EQ(script.scale, 1.75);
  std::vector<InputEvent> played;
  double waited = 0.0;
  for (const ScriptStep& step : script.steps) {
    if (const auto* event = std::get_if<ScriptEvent>(&step)) played.push_back(event->event);
    if (const auto* wait = std::get_if<ScriptWait>(&step)) waited += wait->seconds;
  }
  std::vector<InputEvent> events(6);
  events[0].x = 12.25, events[0].y = 40.0;
  events[1].kind = Kind::kPress, events[1].button = MouseButton::kRight, events[1].shift = true;
  events[2].kind = Kind::kWheel, events[2].amount = -2.0, events[2].across = 0.5;
  events[3].kind = Kind::kKeyPress, events[3].key = Key::kPad7, events[3].control = true;
  events[4].kind = Kind::kText, events[4].character = '"';
  events[5].kind = Kind::kOpen, events[5].path = "/scans/head \"1\".nrrd";
  EXPECT_EQ(played, events);
  EXPECT_EQ(waited, 0.25);
}

TEST(ViewScriptTest, ATurntableGoesAllAround) {
  ScriptPlayer player(
      viewScriptFromJson(R"({"steps": [{"turntable": {"frames": 4, "name": "head"}}]})"));
  ViewState state;
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(player.next(i, {true}, state).state->camera.azimuth, -180.0 + 90.0 * i);
    EXPECT_FALSE(player.next(i, {false}, state).file);
    EXPECT_FALSE(player.next(i, {true}, state).file);
    const ScriptFrame picture = player.next(i, {true}, state);
    ASSERT_TRUE(picture.file);
    EXPECT_EQ(picture.file->name, "head-000" + std::to_string(i + 1) + ".png");
    EXPECT_EQ(picture.finished, i == 3);
  }
}

TEST(ViewScriptTest, SweepsAndPatchesChangeTheStateAlone) {
  ScriptPlayer player(viewScriptFromJson(R"({"steps": [
      {"sweep": {"isovalue": [500, 1250], "seconds": 2}},
      {"set": {"wireframe": true, "focus": {"radius": 20}}},
      {"set": {"focus": {"radius": -1}}}]})"));
  ViewState state;
  state.focus.center = {1.0, 2.0, 3.0};
  EXPECT_EQ(player.next(10.0, {false}, state).state->surfaces[0].isovalue, 500.0);
  EXPECT_EQ(player.next(11.0, {false}, state).state->surfaces[0].isovalue, 875.0);
  const ScriptFrame end = player.next(13.0, {false}, state);
  EXPECT_EQ(end.state->surfaces[0].isovalue, 1250.0);
  ViewState expected = state;
  expected.wireframe = true;
  expected.focus.radius = 20.0;
  EXPECT_EQ(player.next(13.1, {false}, state).state, expected);
  EXPECT_THROW(player.next(13.2, {false}, state), Error);
}

// Nothing takes the place of a preview before the next wait.
TEST(ViewScriptTest, AWaitForAPreviewKeepsIt) {
  ScriptPlayer player(viewScriptFromJson(R"({"steps": [
      {"wait": "preview"}, {"key_press": "W"}, {"wait": "settled"}, {"wait": "preview"}]})"));
  const ViewState state;
  EXPECT_FALSE(player.keepsPreview());
  player.next(0.0, {false, false}, state);
  EXPECT_TRUE(player.keepsPreview());
  EXPECT_TRUE(player.next(1.0, {false, false}, state).events.empty());
  EXPECT_TRUE(player.next(2.0, {false, true}, state).events.empty());  // it is over
  EXPECT_EQ(player.next(3.0, {false, true}, state).events.size(), 1u);
  EXPECT_TRUE(player.keepsPreview());
  EXPECT_FALSE(player.next(4.0, {false, true}, state).finished);
  EXPECT_FALSE(player.keepsPreview());
  player.next(5.0, {true, false}, state);
  EXPECT_TRUE(player.next(6.0, {true, false}, state).finished);  // there is none to come
  EXPECT_FALSE(player.keepsPreview());
}

TEST(ViewScriptTest, TextThatIsNestedDeepIsRefusedBeforeItTakesTheStack) {
  std::string text = "1";
  for (int depth = 0; depth < 20; ++depth) text = R"({"a":)" + text + "}";
  EXPECT_THROW(viewScriptFromJson(R"({"steps":[{"set":)" + text + "}]}"), Error);
  EXPECT_THROW(viewScriptFromJson(R"({"steps":[{"set":{"a":)" + std::string(100'000, '[') +
                                  std::string(100'000, ']') + "}}]}"),
               Error);
}

}  // namespace
}  // namespace isobrick
