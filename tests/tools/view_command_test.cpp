// `isobrick view` run by scripts: in a window of a virtual display, and without one.
#include <fstream>
#include <random>

#include "isobrick/viewer/state/input_event.h"
#include "tests/support/command_test.h"
#include "tests/support/requirement.h"

namespace isobrick::test {
namespace {

constexpr char kXvfbRun[] = "/usr/bin/xvfb-run";

class ViewCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "sphere", "--size", "40", "-o", "sphere.mhd"});
    runWell({"build", "sphere.mhd"});
    write("script.json", R"({"size": [400, 300], "steps": [
        {"wait": "settled"},
        {"frame": "open.png"},
        {"key": "TAB"},
        {"double_click": [200, 150]},
        {"drag": {"from": [200, 150], "to": [260, 170], "seconds": 0.1}},
        {"sweep": {"isovalue": [-2, 1], "seconds": 0.2}},
        {"wheel": 2, "control": true},
        {"key": "X"}, {"key": "C"}, {"key": "W"},
        {"resize": [320, 200]},
        {"set": {"slices": [{}, {}, {"shown": true, "position": 20}]}},
        {"wait": "settled"},
        {"frame": "end.png"}, {"picture": "end.exr"}, {"mesh": "end.ply"}, {"state": "end.json"},
        {"wait": "settled"}]})");
  }

  void write(const std::string& name, const std::string& text) {
    std::ofstream(path(name)) << text;
  }
  void checkResults() {
    for (const char* name : {"open.png", "end.png", "end.exr", "end.ply", "end.json"})
      EXPECT_GT(fs::file_size(path(std::string("frames/") + name)), 100u) << name;
    const Json state = Json::parse(readBytes(path("frames/end.json")));
    EXPECT_EQ(state["wireframe"], true);
    EXPECT_EQ(state["coloring"], "level");
    EXPECT_EQ(state["surfaces"][0]["isovalue"], 1.0);
    EXPECT_EQ(state["clip_planes"].size(), 1u);
    EXPECT_NE(state["camera"]["azimuth"], 25.0);
    const Json report = Json::parse(readBytes(path("report.json")));
    EXPECT_GT(report["frames"], 20);
    EXPECT_GT(report["passes"], 2);
    EXPECT_EQ(report["each_frame"].size(), report["frames"]);
    EXPECT_GT(report["each_frame"].back()["triangles"], 100);
  }
};

TEST_F(ViewCommandTest, AScriptRunsWithoutAWindow) {
  EXPECT_EQ(runWell({"view", "sphere.isb", "--offscreen", "--script", "script.json", "--frames",
                     "frames", "--report", "report.json"}),
            "");
  checkResults();
  // The saved view opens again, and is the same.
  write("again.json",
        R"({"size": [320, 200], "steps": [{"wait": "settled"}, {"state": "again.json"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "again.json", "--frames", "frames",
           "--state", "frames/end.json"});
  EXPECT_EQ(readBytes(path("frames/again.json")), readBytes(path("frames/end.json")));
}

// The drag and the keys come again as they were; what a script set itself is no hand's.
TEST_F(ViewCommandTest, WhatWasRecordedRunsAgain) {
  write("hands.json", R"({"size": [300, 200], "steps": [
      {"key": "TAB"}, {"drag": {"from": [100, 100], "to": [160, 90], "seconds": 0.05}},
      {"key": "W"}, {"resize": [320, 240]}, {"wheel": 1}, {"state": "first.json"}]})");
  runWell(
      {"view", "sphere.isb", "--offscreen", "--script", "hands.json", "--record", "again.json"});
  Json again = Json::parse(readBytes(path("again.json")));
  again["steps"].push_back({{"state", "second.json"}});
  write("again.json", again.dump());
  runWell({"view", "sphere.isb", "--offscreen", "--script", "again.json"});
  const Json first = Json::parse(readBytes(path("first.json")));
  EXPECT_EQ(first["wireframe"], true);
  EXPECT_EQ(Json::parse(readBytes(path("second.json"))), first);
}

TEST_F(ViewCommandTest, TheSameScriptRunsInAWindow) {
  if (!fs::exists(kXvfbRun)) SKIP_UNLESS_REQUIRED("xvfb is not installed");
  // The driver of X11 is unloaded with two small blocks of its own.
  const Outcome outcome =
      wait(start({"/usr/bin/env", "ASAN_OPTIONS=detect_leaks=0", kXvfbRun, "-a", "-s",
                  "-screen 0 1024x768x24", isobrickCommand(), "view", "sphere.isb", "--script",
                  "script.json", "--frames", "frames", "--report", "report.json"}));
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_EQ(outcome.err, "");
  checkResults();
}

TEST_F(ViewCommandTest, RenderDrawsWhatTheViewerShows) {
  write("show.json", R"({"size": [320, 200], "steps": [
      {"set": {"surfaces": [{"isovalue": 1}], "slices": [{}, {}, {"shown": true, "position": 20}],
               "clip_planes": [{"normal": [1, 0, 0], "offset": 15}], "coloring": "level"}},
      {"wait": "settled"}, {"picture": "seen.png"}, {"state": "seen.json"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "show.json", "--frames", "frames"});
  runWell({"render", "sphere.isb", "--state", "frames/seen.json", "--size", "320x200", "-o",
           "same.png"});
  EXPECT_EQ(readBytes(path("same.png")), readBytes(path("frames/seen.png")));
  expectFailure(2, {"render", "sphere.isb", "-o", "a.png"}, "--iso");
  expectFailure(
      2, {"render", "sphere.isb", "-o", "a.png", "--state", "frames/seen.json", "--iso", "3"},
      "--iso");
  expectFailure(
      2, {"render", "sphere.isb", "-o", "a.png", "--state", "frames/seen.json", "--wireframe"},
      "--wireframe");
  expectFailure(1, {"render", "sphere.isb", "-o", "a.png", "--state", "missing.json"},
                "missing.json");
}

// Whatever hands do, on panels too, and with no picture at all in between.
TEST_F(ViewCommandTest, RandomEventsEndTidily) {
  std::mt19937 random(11);
  const auto draw = [&](int below) {
    return static_cast<int>(random() % static_cast<unsigned>(below));
  };
  Json steps = Json::array();
  for (int i = 0; i < 150; ++i) {
    const Json place{draw(420) - 10, draw(320) - 10};
    const char* const buttons[] = {"left", "middle", "right"};
    const Json choices[] = {
        {{"move", place}},
        {{"press", buttons[draw(3)]}},
        {{"release", buttons[draw(3)]}},
        {{"click", place}},
        {{"double_click", place}},
        {{"wheel", draw(9) - 4}, {"control", draw(2) == 0}},
        {{"key", kKeyNames[static_cast<std::size_t>(1 + draw(static_cast<int>(kKeyCount) - 1))]},
         {"shift", draw(2) == 0}},
        {{"sweep", {{"isovalue", {draw(40) - 20, draw(40) - 20}}, {"seconds", 0.02}}}},
        {{"drag", {{"from", place}, {"to", {draw(400), draw(300)}}, {"seconds", 0.02}}}}};
    steps.push_back(choices[draw(9)]);
    if (i == 100) steps.push_back({{"resize", {0, 0}}});
    if (i == 110) steps.push_back({{"resize", {200, 150}}});
    if (i == 130) steps.push_back({{"resize", {7, 300}}});
  }
  steps.push_back({{"wait", "settled"}});
  write("random.json", Json{{"size", {400, 300}}, {"steps", steps}}.dump());
  runWell({"view", "sphere.isb", "--offscreen", "--script", "random.json", "--gpu-memory", "1M"});
}

TEST_F(ViewCommandTest, WithoutADisplayTheWayOutIsTold) {
  const Outcome outcome = wait(start({"/usr/bin/env", "-u", "DISPLAY", "-u", "WAYLAND_DISPLAY",
                                      isobrickCommand(), "view", "sphere.isb"}));
  checkFailure(outcome, 1, "'isobrick render' draws pictures");
}

TEST_F(ViewCommandTest, WrongFilesAreOneLine) {
  expectFailure(1, {"view", "missing.isb"}, "missing.isb");
  expectFailure(1, {"view", "sphere.isb", "--offscreen", "--script", "missing.json"},
                "missing.json");
  write("bad.json", R"({"steps": [{"jump": 1}]})");
  expectFailure(1, {"view", "sphere.isb", "--offscreen", "--script", "bad.json"}, "step 1 'jump'");
  write("view.json", R"({"focus": {"radius": "wide"}})");
  expectFailure(
      1, {"view", "sphere.isb", "--offscreen", "--script", "script.json", "--state", "view.json"},
      "focus.radius");
  expectFailure(2, {"view", "sphere.isb", "--offscreen"}, "--script");
  expectFailure(2, {"view"}, "FILE");
}

}  // namespace
}  // namespace isobrick::test
