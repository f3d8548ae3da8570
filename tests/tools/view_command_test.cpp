// `isobrick view` run by scripts: in a window of a virtual display, and without one.
#include <array>
#include <chrono>
#include <cmath>
#include <fstream>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <numbers>
#include <random>
#include <sstream>
#include <thread>

#include "isobrick/viewer/state/input_event.h"
#include "tests/support/command_test.h"
#include "tests/support/dicom_file.h"
#include "tests/support/ply_reader.h"
#include "tests/support/requirement.h"

namespace isobrick::test {
namespace {

constexpr char kXvfbRun[] = "/usr/bin/xvfb-run";

class ViewCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "sphere", "--voxels", "40", "-o", "sphere.mhd"});
    runWell({"build", "sphere.mhd"});
    write("script.json", R"({"size": [400, 300], "steps": [
        {"wait": "settled"},
        {"frame": "open.png"},
        {"key": "TAB"},
        {"double_click": [200, 150]},
        {"drag": {"from": [200, 150], "to": [260, 170], "seconds": 0.1}},
        {"sweep": {"isovalue": [-2, 1], "seconds": 0.2}},
        {"wheel": 2, "control": true},
        {"key": "X"}, {"key": "C"}, {"lose_context": true}, {"key": "W"},
        {"resize": [320, 200]},
        {"set": {"slices": [{}, {}, {"shown": true, "position": 20}]}},
        {"wait": "settled"},
        {"frame": "end.png"}, {"picture": "end.exr"}, {"mesh": "end.ply"}, {"state": "end.json"},
        {"wait": "settled"}, {"shown_mesh": "shown.ply"}]})");
  }

  // Triangles of the mesh that a script writes.
  std::string facesOf(const char* name) {
    const std::string file = readBytes(path(std::string("frames/") + name));
    const std::size_t at = file.find("element face ") + 13;
    return file.substr(at, file.find('\n', at) - at);
  }
  void write(const std::string& name, const std::string& text) {
    std::ofstream(path(name)) << text;
  }
  // Raw floats, at the isovalue 0 a ball of this radius.
  void writeBall(const std::string& name, int voxels, double radius) {
    std::ofstream file(path(name), std::ios::binary);
    const double middle = 0.5 * (voxels - 1);
    for (int z = 0; z < voxels; ++z)
      for (int y = 0; y < voxels; ++y)
        for (int x = 0; x < voxels; ++x) {
          const glm::dvec3 at(x, y, z);
          const auto value = static_cast<float>(radius - glm::distance(at, glm::dvec3(middle)));
          file.write(reinterpret_cast<const char*>(&value), sizeof value);
        }
  }
  void checkResults() {
    for (const char* name : {"open.png", "end.png", "end.exr", "end.ply", "end.json"})
      EXPECT_GT(fs::file_size(path(std::string("frames/") + name)), 100u) << name;
    // What is on the screen in the end is what was to be shown, but for the bits of normals.
    const auto countsOf = [&](const char* name) {
      const std::string file = readBytes(path(std::string("frames/") + name));
      const std::size_t vertices = file.find("element vertex"), faces = file.find("element face");
      return std::pair(file.substr(vertices, file.find('\n', vertices) - vertices),
                       file.substr(faces, file.find('\n', faces) - faces));
    };
    EXPECT_EQ(countsOf("shown.ply"), countsOf("end.ply"));
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

TEST_F(ViewCommandTest, ShowsWhatARegionLeaves) {
  write("cut.json", R"({"size": [200, 150], "steps": [
      {"set": {"surfaces": [{"isovalue": 0}], "focus": {"radius": 1000}}}, {"wait": "settled"},
      {"shown_mesh": "cut.ply"}]})");
  runWell({"view", "sphere.isb", "--clip", "1,0,0,20", "--offscreen", "--script", "cut.json",
           "--out-dir", "frames"});
  const Json cut = runForJson({"extract", "sphere.isb", "--iso", "0", "--clip", "1,0,0,20"});
  EXPECT_EQ(facesOf("cut.ply"), std::to_string(cut["triangles"].get<int>()));
}

// The volume is its own mask.
TEST_F(ViewCommandTest, ASavedViewHasItsRegion) {
  const Words region{"--clip", "1,0,0,20", "--sphere", "20,20,20,14", "--mask", "sphere.isb"};
  const auto trianglesWith = [&](const Words& words) {
    Words extract{"extract", "sphere.isb", "--iso", "0"};
    extract.insert(extract.end(), words.begin(), words.end());
    return std::to_string(runForJson(extract)["triangles"].get<int>());
  };
  write("save.json", R"({"size": [200, 150], "steps": [
      {"set": {"surfaces": [{"isovalue": 0}], "focus": {"radius": 1000}}}, {"wait": "settled"},
      {"state": "cut.view.json"}, {"picture": "cut.png"}]})");
  write("show.json",
        R"({"size": [200, 150], "steps": [{"wait": "settled"}, {"shown_mesh": "cut.ply"}]})");
  Words save{"view", "sphere.isb"};
  save.insert(save.end(), region.begin(), region.end());
  save.insert(save.end(), {"--offscreen", "--script", "save.json", "--out-dir", "frames"});
  runWell(save);
  const Words show{"view",        "sphere.isb", "--state",   "frames/cut.view.json",
                   "--offscreen", "--script",   "show.json", "--out-dir",
                   "frames"};
  runWell(show);
  EXPECT_EQ(facesOf("cut.ply"), trianglesWith(region));
  runWell({"render", "sphere.isb", "--state", "frames/cut.view.json", "--size", "200x150", "-o",
           "drawn.png"});
  EXPECT_EQ(readBytes(path("drawn.png")), readBytes(path("frames/cut.png")));
  // Words take its place.
  Words other = show;
  other.insert(other.end(), {"--clip", "0,0,1,20", "--force"});
  runWell(other);
  EXPECT_EQ(facesOf("cut.ply"), trianglesWith({"--clip", "0,0,1,20"}));
}

TEST_F(ViewCommandTest, AScriptRunsWithoutAWindow) {
  EXPECT_EQ(runWell({"view", "sphere.isb", "--offscreen", "--script", "script.json", "--out-dir",
                     "frames", "--report", "report.json"}),
            "");
  checkResults();
  // The saved view opens again, and is the same.
  write("again.json",
        R"({"size": [320, 200], "steps": [{"wait": "settled"}, {"state": "again.json"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "again.json", "--out-dir", "frames",
           "--state", "frames/end.json"});
  EXPECT_EQ(readBytes(path("frames/again.json")), readBytes(path("frames/end.json")));
}

TEST_F(ViewCommandTest, TheSameScriptRunsInAWindow) {
  if (!fs::exists(kXvfbRun)) SKIP_UNLESS_REQUIRED("xvfb is not installed");
  // The driver of X11 is unloaded with two small blocks of its own.
  const Outcome outcome =
      wait(start({"/usr/bin/env", "ASAN_OPTIONS=detect_leaks=0", kXvfbRun, "-a", "-s",
                  "-screen 0 1024x768x24", isobrickCommand(), "view", "sphere.isb", "--script",
                  "script.json", "--out-dir", "frames", "--report", "report.json"}));
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_EQ(outcome.err, "");
  checkResults();
}

TEST_F(ViewCommandTest, StepsOfTimeHaveOneView) {
  Words steps{"view"}, drawn{"render"};
  for (int step = 0; step < 5; ++step) {
    const std::string name = "run-" + std::to_string(step);
    writeBall(name + ".raw", 30, 7.0 + 1.5 * step);
    runWell({"build", name + ".raw", "--raw-dims", "30,30,30", "--raw-type", "f32"});
    for (Words* words : {&steps, &drawn}) words->push_back(name + ".isb");
  }
  // Each by its key, by its number, by undo, and after playing.
  write("steps.json", R"({"size": [300, 200], "steps": [
      {"wait": "settled"}, {"set": {"surfaces": [{"isovalue": 1}]}}, {"wait": "settled"},
      {"picture": "run-0.png"},
      {"key": "UP"}, {"wait": "settled"}, {"picture": "run-1.png"},
      {"set": {"step": 2}}, {"wait": "settled"}, {"picture": "run-2.png"}, {"wait": 0.6},
      {"set": {"step": 9}}, {"wait": "settled"}, {"picture": "run-4.png"}, {"wait": 0.6},
      {"key": "DOWN"}, {"wait": "settled"}, {"picture": "run-3.png"}, {"state": "v.json"},
      {"key": "S", "control": true}, {"wait": 0.6},
      {"key": "Z", "control": true}, {"wait": "settled"}, {"picture": "undone.png"},
      {"key": "Z", "control": true, "shift": true}, {"wait": "settled"}, {"picture": "redone.png"},
      {"key": "J"}, {"wait": 2}, {"key": "J"}, {"wait": "settled"}, {"state": "played.json"}]})");
  steps.insert(steps.end(),
               {"--steps", "--offscreen", "--script", "steps.json", "--out-dir", "frames"});
  runWell(steps);
  EXPECT_EQ(Json::parse(readBytes(path("frames/v.json")))["step"], 3);
  // The view is that of all steps.
  EXPECT_EQ(Json::parse(readBytes(path("run-0.view.json")))["step"], 3);
  drawn.insert(drawn.end(),
               {"--steps", "--state", "frames/v.json", "--size", "300x200", "-o", "{name}.png"});
  runWell(drawn);
  const auto picture = [&](const std::string& name) { return readBytes(path(name + ".png")); };
  for (int step = 0; step < 5; ++step) {
    const std::string name = "run-" + std::to_string(step);
    EXPECT_EQ(picture("frames/" + name), picture(name)) << step;
    EXPECT_EQ(step > 0 && picture(name) == picture("run-0"), false) << step;
  }
  EXPECT_EQ(picture("frames/undone"), picture("run-4"));
  EXPECT_EQ(picture("frames/redone"), picture("run-3"));
  // The view opens with its step.
  write("again.json",
        R"({"size": [300, 200], "steps": [{"wait": "settled"}, {"picture": "again.png"}]})");
  steps[steps.size() - 3] = "again.json";
  steps.insert(steps.end(), {"--state", "frames/v.json"});
  runWell(steps);
  EXPECT_EQ(picture("frames/again"), picture("run-3"));
  // One of another grid is not shown; and steps have the names that they were given.
  write("other.json", R"({"size": [300, 200], "steps": [{"wait": "settled"}, {"set": {"step": 1}},
      {"wait": "settled"}, {"state": "other.json"}]})");
  for (const char* last : {"run-0.isb", "sphere.mhd"}) {
    runWell({"view", "sphere.mhd", last, "--steps", "--offscreen", "--script", "other.json",
             "--out-dir", "frames", "--force"});
    const Json shown = Json::parse(readBytes(path("frames/other.json")));
    EXPECT_EQ(shown["volume"], path("sphere.mhd"));
    EXPECT_EQ(shown["step"], last == std::string("sphere.mhd") ? 1 : 0);
  }
  expectFailure(2, {"view", "run-0.isb", "--steps"}, "give more of them");
  Words many(9, "sphere.isb");
  many.insert(many.begin(), "view");
  expectFailure(2, many, "--steps");
}

TEST_F(ViewCommandTest, JsonSaysWhatTheScriptWrote) {
  write("one.json", R"({"steps": [{"wait": "settled"}, {"state": "one.view.json"}]})");
  const Json shown = runForJson(
      {"view", "sphere.isb", "--offscreen", "--script", "one.json", "--out-dir", "frames"});
  EXPECT_EQ(shown["volumes"], Json({"sphere.isb"}));
  EXPECT_EQ(shown["written"], Json({"frames/one.view.json"}));
  EXPECT_EQ(shown["report"], nullptr);
  EXPECT_TRUE(fs::exists(path("frames/one.view.json")));
}

TEST_F(ViewCommandTest, SeveralVolumesAreInOneScene) {
  runWell({"phantom", "head", "--voxels", "40", "-o", "head.nrrd"});
  runWell({"build", "head.nrrd", "--spacing", "0.7,0.7,0.9", "--origin", "30,5,0"});
  write("both.json", R"({"size": [400, 300], "steps": [
      {"wait": "settled"}, {"picture": "both.png"}, {"state": "both.view.json"}]})");
  runWell({"view", "sphere.isb", "head.isb", "--offscreen", "--script", "both.json", "--out-dir",
           "frames"});
  const Json view = Json::parse(readBytes(path("frames/both.view.json")));
  EXPECT_EQ(view["surfaces"][1]["volume"], 1);
  const auto drawn = [&](const Words& files) {
    Words words{"render", "--state",  "frames/both.view.json", "--size", "400x300", "--force",
                "-o",     "drawn.png"};
    words.insert(words.begin() + 1, files.begin(), files.end());
    runWell(words);
    return readBytes(path("drawn.png"));
  };
  const std::string both = readBytes(path("frames/both.png"));
  EXPECT_EQ(drawn({"sphere.isb", "head.isb"}), both);
  EXPECT_EQ(drawn({"sphere.isb"}), both);  // the view names the other one
  // So does the window, with the view alone, and with the first.
  for (const Words& files : {Words(), Words{"sphere.isb"}}) {
    Words words{"view",        "--state",   "frames/both.view.json",
                "--offscreen", "--script",  "both.json",
                "--force",     "--out-dir", "again"};
    words.insert(words.begin() + 1, files.begin(), files.end());
    runWell(words);
    EXPECT_EQ(readBytes(path("again/both.png")), both);
  }
  // Volumes keep their names.
  runWell({"view", "sphere.mhd", "head.nrrd", "--offscreen", "--script", "both.json", "--out-dir",
           "named"});
  const Json named = Json::parse(readBytes(path("named/both.view.json")));
  EXPECT_EQ(named["volume"], path("sphere.mhd"));
  EXPECT_EQ(named["beside"], Json::array({path("head.nrrd")}));
}

TEST_F(ViewCommandTest, RenderDrawsWhatTheViewerShows) {
  write("show.json", R"({"size": [320, 200], "steps": [
      {"set": {"surfaces": [{"isovalue": 1}], "slices": [{}, {}, {"shown": true, "position": 20}],
               "clip_planes": [{"normal": [1, 0, 0], "offset": 15}], "coloring": "level"}},
      {"wait": "settled"}, {"picture": "bare.png"},
      {"set": {"pictures": {"scale_bar": true, "axes": true, "legend": true}}},
      {"wait": "settled"}, {"picture": "seen.png"}, {"state": "seen.json"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "show.json", "--out-dir", "frames"});
  runWell({"render", "sphere.isb", "--state", "frames/seen.json", "--size", "320x200", "-o",
           "same.png"});
  EXPECT_EQ(readBytes(path("same.png")), readBytes(path("frames/seen.png")));
  EXPECT_NE(readBytes(path("same.png")), readBytes(path("frames/bare.png")));
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

// As many pixels as were asked for, without a background, and the window's own afterwards.
TEST_F(ViewCommandTest, PicturesAreLargerThanTheWindowAndTransparent) {
  write("pictures.json", R"({"size": [160, 120], "steps": [
      {"wait": "settled"}, {"frame": "before.png"}, {"picture": "plain.png"},
      {"set": {"pictures": {"transparent": true, "times": 3}, "wireframe": true}},
      {"set": {"wireframe": false}},
      {"picture": "large.png"}, {"picture": "large.exr"},
      {"set": {"pictures": {"transparent": false, "times": 1}}}, {"wait": "settled"},
      {"picture": "again.png"}, {"key": "P", "shift": true}, {"wait": 0.01}]})");
  runWell(
      {"view", "sphere.isb", "--offscreen", "--script", "pictures.json", "--out-dir", "frames"});
  const auto sizeAndColor = [&](const char* name) {
    const std::string bytes = readBytes(path(std::string("frames/") + name));
    const auto big_endian = [&](std::size_t at) {
      int value = 0;
      for (std::size_t i = 0; i < 4; ++i)
        value = 256 * value + static_cast<unsigned char>(bytes.at(at + i));
      return value;
    };
    return std::array<int, 3>{big_endian(16), big_endian(20), bytes.at(25)};
  };
  EXPECT_EQ(sizeAndColor("plain.png"), (std::array<int, 3>{160, 120, 2}));
  EXPECT_EQ(sizeAndColor("large.png"), (std::array<int, 3>{480, 360, 6}));  // with alpha
  EXPECT_EQ(readBytes(path("frames/again.png")), readBytes(path("frames/plain.png")));
  EXPECT_GT(fs::file_size(path("sphere-0001.exr")), 1000u);
}

// Whatever the user does, on panels too, and with no picture at all in between.
TEST_F(ViewCommandTest, RandomEventsEndTidily) {
  std::mt19937 random(11);
  const auto draw = [&](int below) {
    return static_cast<int>(random() % static_cast<unsigned>(below));
  };
  Json steps = Json::array();
  // As many as one asks for by hand, under sanitizers too.
  const int events = environmentOr("ISOBRICK_RANDOM_EVENTS", 150);
  for (int i = 0; i < events; ++i) {
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

// The driver is reset, or a laptop wakes: the same pictures as before, panels and slices included.
TEST_F(ViewCommandTest, WhatIsShownOutlivesItsContext) {
  write("loss.json", R"({"size": [300, 200], "steps": [
      {"set": {"slices": [{}, {}, {"shown": true, "position": 20}], "coloring": "gradient",
               "focus": {"everywhere": true}}},
      {"wait": "settled"}, {"picture": "before.png"}, {"state": "before.json"},
      {"lose_context": true}, {"wait": "settled"}, {"picture": "after.png"},
      {"state": "after.json"}, {"sweep": {"isovalue": [-2, 1], "seconds": 0.1}},
      {"lose_context": true}, {"lose_context": true}, {"frame": "end.png"},
      {"resize": [0, 0]}, {"lose_context": true}, {"wait": 0.05}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "loss.json"});
  EXPECT_EQ(readBytes(path("after.png")), readBytes(path("before.png")));
  EXPECT_EQ(readBytes(path("after.json")), readBytes(path("before.json")));
  EXPECT_GT(fs::file_size(path("end.png")), 1000u);
}

// A pyramid beside the volume is used if it is up to date; otherwise one is built into the cache.
TEST_F(ViewCommandTest, VolumesAreBuiltAndUsedAgain) {
  runWell({"build", "sphere.mhd"});
  const std::string built = readBytes(path("sphere.isb"));
  write("state.json",
        R"({"size": [120, 90], "steps": [{"wait": "settled"}, {"state": "a.json"}]})");
  runWell(
      {"view", "sphere.mhd", "--offscreen", "--script", "state.json", "--cache-folder", "cache"});
  EXPECT_EQ(readBytes(path("sphere.isb")), built);
  EXPECT_FALSE(fs::exists(path("cache")));
  fs::remove(path("sphere.isb"));
  runWell({"view", "sphere.mhd", "--offscreen", "--script", "state.json", "--cache-folder", "cache",
           "--force"});
  EXPECT_FALSE(fs::exists(path("sphere.isb")));
  std::set<std::string> cached;
  for (const std::string& file : files())
    if (file.rfind("cache/", 0) == 0 && file.ends_with(".isb")) cached.insert(file);
  ASSERT_EQ(cached.size(), 1u);
  const auto time = fs::last_write_time(path(*cached.begin()));
  runWell({"view", "sphere.mhd", "--offscreen", "--script", "state.json", "--cache-folder", "cache",
           "--force"});
  EXPECT_EQ(fs::last_write_time(path(*cached.begin())), time);
  EXPECT_FALSE(fs::exists(path("cache") + "/recent"));
}

// A series, a phantom, rubbish and a pyramid, one after the other in one window.
TEST_F(ViewCommandTest, VolumesAreOpenedOneAfterTheOther) {
  fs::create_directory(path("series"));
  std::vector<std::int16_t> values;
  for (int i = 0; i < 20 * 20 * 20; ++i) values.push_back(static_cast<std::int16_t>(i % 20 * 50));
  writeDicomSeries(path("series"), Index3(20), values);
  write("rubbish", std::string(5000, 'x'));
  write("open.json", R"({"size": [160, 120], "steps": [
      {"frame": "nothing.png"},
      {"open": "series"}, {"wait": "settled"}, {"state": "series.json"},
      {"open": "phantom:gyroid:40"}, {"wait": "settled"}, {"state": "gyroid.json"},
      {"open": "rubbish"}, {"wait": "settled"}, {"state": "after.json"}, {"frame": "rubbish.png"},
      {"open": "missing"}, {"open": "phantom:nobody"}, {"wait": "settled"},
      {"open": "sphere.isb"}, {"wait": "settled"}, {"mesh": "sphere.ply"}, {"wait": "settled"}]})");
  runWell({"view", "--offscreen", "--script", "open.json"});
  EXPECT_FALSE(fs::exists(path("series.isb")));
  EXPECT_EQ(runForJson({"cache"})["pyramids"].size(), 2u);
  const auto centerOf = [&](const char* file) {
    return Json::parse(readBytes(path(file)))["focus"]["center"][0];
  };
  EXPECT_EQ(centerOf("series.json"), 9.5);
  EXPECT_EQ(centerOf("gyroid.json"), 19.5);
  EXPECT_EQ(readBytes(path("after.json")), readBytes(path("gyroid.json")));  // rubbish left it
  EXPECT_GT(fs::file_size(path("sphere.ply")), 1000u);
  EXPECT_GT(fs::file_size(path("nothing.png")), 100u);
}

// They are listed: the keyboard or the mouse chooses one, and a script that does not is refused.
TEST_F(ViewCommandTest, OneOfSeveralSeriesIsChosenInTheWindow) {
  fs::create_directory(path("scans"));
  for (int series = 1; series <= 2; ++series)
    for (int k = 1; k <= 16; ++k) {
      DicomSliceFile slice;
      slice.columns = 16 + 8 * (series - 1);
      slice.rows = 16;
      for (std::int64_t i = 0; i < slice.columns * slice.rows; ++i)
        slice.pixels.push_back(static_cast<std::int16_t>(i % slice.columns * 50));
      slice.position.z = k;
      slice.instance = k;
      slice.series_uid = "1.2.3." + std::to_string(series);
      writeDicomSlice(path("scans/" + std::to_string(100 * series + k)), slice);
    }
  const auto centerAfter = [&](const std::string& steps) {
    write("choose.json", R"({"size": [640, 400], "steps": [{"wait": "settled"}, )" + steps +
                             R"( {"wait": "settled"}, {"state": "chosen.json"}]})");
    runWell({"view", "scans", "--offscreen", "--script", "choose.json", "--force"});
    return Json::parse(readBytes(path("chosen.json")))["focus"]["center"][0];
  };
  EXPECT_EQ(centerAfter(R"({"key": "DOWN"}, {"key": "ENTER"},)"), 11.5);
  EXPECT_EQ(centerAfter(R"({"key": "DOWN"}, {"key": "UP"}, {"key": "ENTER"},)"), 7.5);
  EXPECT_EQ(centerAfter(R"({"move": [200, 140]}, {"press": "left"}, {"release": "left"},)"), 11.5);
  for (const char* const steps :
       {R"({"frame": "list.png"}, {"wait": 0.1})", R"({"state": "no.json"})"}) {
    write("none.json",
          R"({"size": [640, 400], "steps": [{"wait": "settled"}, )" + std::string(steps) + "]}");
    const Outcome outcome = run({"view", "scans", "--offscreen", "--script", "none.json"});
    checkFailure(outcome, 1, "it holds 2 DICOM series");
    checkFailure(outcome, 1, "--select series=NUMBER");
  }
  EXPECT_GT(fs::file_size(path("list.png")), 1000u);
}

// While it is built a volume is shown by a preview, of which nothing is left; a folder of a process
// that was killed goes as well.
TEST_F(ViewCommandTest, AVolumeIsShownWhileItIsBuilt) {
  fs::create_directories(path("place/isobrick-preview-999999999-abcdef"));
  write("place/isobrick-preview-999999999-abcdef/1.isb", "left");
  write("preview.json", R"({"size": [160, 120], "steps": [
      {"wait": "preview"}, {"shown_mesh": "preview.ply"}, {"frame": "preview.png"},
      {"set": {"surfaces": [{"isovalue": 8.5}], "focus": {"radius": 31},
               "camera": {"azimuth": 10}, "clip_planes": [{"normal": [1, 0, 0], "offset": 30}]}},
      {"state": "preview.json"},
      {"wait": "settled"}, {"state": "whole.json"}, {"mesh": "whole.ply"},
      {"wait": "settled"}]})");
  const Outcome outcome =
      wait(start({"/usr/bin/env", "XDG_RUNTIME_DIR=" + path("place"), isobrickCommand(), "view",
                  "phantom:sphere:160", "--offscreen", "--preview-share", "1", "--script",
                  "preview.json", "--out-dir", "frames"}));
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_TRUE(fs::is_empty(path("place")));
  EXPECT_EQ(runForJson({"cache"})["pyramids"].size(), 1u);
  for (const char* mesh : {"frames/preview.ply", "frames/whole.ply"})
    EXPECT_GT(fs::file_size(path(mesh)), 1000u) << mesh;
  Json before = Json::parse(readBytes(path("frames/preview.json")));
  Json after = Json::parse(readBytes(path("frames/whole.json")));
  EXPECT_EQ(before["focus"]["radius"], 31.0);
  before.erase("value_window");  // of all values
  after.erase("value_window");
  EXPECT_EQ(after, before);
}

// The preview of a store is a level of its own, and the surface in it lies where that of the
// pyramid does.
TEST_F(ViewCommandTest, AStoreIsShownByALevelOfItsOwn) {
  runWell({"build", "phantom:sphere:160", "-o", "s.isb"});
  runWell({"convert", "s.isb", "--all-levels", "-o", "s.ome.zarr"});
  write("preview.json", R"({"size": [160, 120], "steps": [
      {"wait": "preview"}, {"set": {"surfaces": [{"isovalue": 8.5}]}},
      {"wait": "preview"}, {"shown_mesh": "preview.ply"},
      {"wait": "settled"}, {"shown_mesh": "whole.ply"}]})");
  runWell(
      {"view", "s.ome.zarr", "--offscreen", "--preview-share", "1", "--script", "preview.json"});
  const auto boxOf = [&](const char* name) {
    const PlyMesh mesh = readPly(path(name));
    glm::dvec3 low(1e9), high(-1e9);
    for (const glm::dvec3& position : mesh.positions) {
      low = glm::min(low, position);
      high = glm::max(high, position);
    }
    return std::array{low, high};
  };
  const auto preview = boxOf("preview.ply"), whole = boxOf("whole.ply");
  for (std::size_t end = 0; end < 2; ++end)
    for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(preview[end][axis], whole[end][axis], 0.5);
}

// Nothing that is pressed loses the object for good.
TEST_F(ViewCommandTest, ViewsComeBack) {
  write("views.json", R"({"size": [400, 300], "steps": [
      {"wait": "settled"}, {"key": "TAB"}, {"wait": 0.5}, {"state": "first.json"},
      {"double_click": [12, 200]}, {"wait": 0.5}, {"state": "beside.json"},
      {"drag": {"from": [200, 150], "to": [260, 170], "seconds": 0.6}}, {"wait": 0.5},
      {"state": "turned.json"},
      {"key": "X"}, {"wait": 0.5}, {"state": "cut.json"},
      {"key": "Z", "control": true}, {"wait": 0.1}, {"state": "uncut.json"},
      {"key": "Z", "control": true}, {"wait": 0.1}, {"state": "unturned.json"},
      {"key": "Z", "control": true, "shift": true}, {"wait": 0.1}, {"state": "redone.json"},
      {"set": {"surfaces": [{"isovalue": 8}]}}, {"wait": "settled"},
      {"key": "F"}, {"wait": "settled"}, {"state": "framed.json"},
      {"key": "HOME"}, {"wait": "settled"}, {"state": "home.json"},
      {"set": {"focus": {"radius": 4, "everywhere": false}}},
      {"key": "F", "shift": true}, {"wait": "settled"}, {"state": "focus.json"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "views.json", "--out-dir", "frames"});
  const auto state = [&](const char* name) {
    return Json::parse(readBytes(path("frames/" + std::string(name) + ".json")));
  };
  EXPECT_EQ(state("beside"), state("first"));
  EXPECT_NE(state("turned"), state("first"));
  EXPECT_NE(state("cut"), state("turned"));
  EXPECT_EQ(state("uncut"), state("turned"));
  EXPECT_EQ(state("unturned"), state("first"));
  EXPECT_EQ(state("redone"), state("turned"));
  // The sphere is smaller than the volume, the focus smaller than the sphere.
  const auto distance = [&](const char* name) {
    return state(name)["camera"]["distance"].get<double>();
  };
  EXPECT_LT(distance("framed"), 0.7 * distance("first"));
  EXPECT_EQ(state("home"), state("first"));
  EXPECT_LT(distance("focus"), 0.5 * distance("first"));
}

// On a sphere: a chord across the picture, and the angle that it takes from the middle, exact by
// its radius.
TEST_F(ViewCommandTest, MeasuresAreThoseOfTheSphere) {
  write("measure.json", R"({"size": [500, 428], "steps": [{"key": "TAB"},
      {"set": {"surfaces": [{"isovalue": 0}], "camera": {"orthographic": true, "azimuth": 0,
               "elevation": 0, "pivot": [19.5, 19.5, 19.5], "distance": 74.641016151377535}}},
      {"wait": "settled"}, {"key": "D"}, {"click": [150, 199.5]}, {"click": [350, 199.5]},
      {"key": "A"}, {"click": [150, 199.5]}, {"click": [250, 199.5]}, {"click": [350, 199.5]},
      {"click": [2, 2]}, {"key": "ESCAPE"}, {"double_click": [2, 2]}, {"wait": "settled"},
      {"measurements": "all.csv"}, {"state": "measured.json"}, {"frame": "window.png"},
      {"picture": "picture.png"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "measure.json", "--out-dir", "frames"});
  const Json state = Json::parse(readBytes(path("frames/measured.json")));
  ASSERT_EQ(state["measurements"].size(), 2u);
  // 400 pixels are 40 voxels high: a tenth of a voxel each.
  const auto point = [&](std::size_t which, std::size_t number) {
    const Json p = state["measurements"][which]["points"][number];
    return glm::dvec3(p[0], p[1], p[2]) - glm::dvec3(19.5);
  };
  const double radius = glm::length(point(1, 1));
  // Pixels have their middle, so the ends are not quite as deep.
  EXPECT_NEAR(glm::distance(point(0, 0), point(0, 1)), 20.0, 0.001);
  for (const std::size_t end : {std::size_t{0}, std::size_t{1}})
    EXPECT_NEAR(glm::length(point(0, end)), radius, 0.05);
  std::istringstream table(readBytes(path("frames/all.csv")));
  std::string head, distance, angle;
  std::getline(table, head);
  std::getline(table, distance);
  std::getline(table, angle);
  EXPECT_NEAR(std::stod(distance.substr(11)), 20.0, 0.001) << distance;
  // Of the middle's angle the legs are chords: 180 degrees minus asin(10 / r).
  const double expected = 180.0 - std::asin(10.0 / radius) * 180.0 / std::numbers::pi;
  EXPECT_NEAR(std::stod(angle.substr(8)), expected, 0.5) << angle;
}

// A view that somebody saved is replaced after a yes alone; one's own is.
TEST_F(ViewCommandTest, ASavedViewIsReplacedAfterAYesAlone) {
  const auto save = [](const char* answer) {
    return Json{{{"key", "TAB"}},  {{"key", "S"}, {"control", true}},
                {{"wait", 0.05}},  {{"frame", "ask.png"}},
                {{"key", answer}}, {{"wait", 0.05}}};
  };
  const auto run = [&](const Json& steps) {
    write("save.json", Json{{"size", {300, 200}}, {"steps", steps}}.dump());
    runWell({"view", "sphere.isb", "--offscreen", "--script", "save.json", "--force"});
    return readBytes(path("sphere.view.json"));
  };
  write("sphere.view.json", "by a hand");
  EXPECT_EQ(run(save("ESCAPE")), "by a hand");
  const std::string saved = run(save("ENTER"));
  EXPECT_EQ(Json::parse(saved)["volume"], "sphere.isb");
  EXPECT_EQ(Json::parse(saved)["version"], 1);
  // Once it is one's own it is replaced at once.
  Json again = save("ENTER");
  again.push_back({{"key", "W"}});
  again.push_back({{"key", "S"}, {"control", true}});
  again.push_back({{"wait", 0.05}});
  EXPECT_EQ(Json::parse(run(again))["wireframe"], true);
  // A view names its volume, which is opened with it.
  write("named.json", R"({"size": [300, 200], "steps": [{"wait": "settled"},
      {"state": "named.view.json"}]})");
  runWell({"view", "--state", "sphere.view.json", "--offscreen", "--script", "named.json"});
  EXPECT_EQ(Json::parse(readBytes(path("named.view.json")))["wireframe"], true);
}

// Views with names lie beside the volume, and come back one after the other.
TEST_F(ViewCommandTest, ViewsWithNamesComeBackOneAfterTheOther) {
  write("names.json", R"({"size": [300, 200], "steps": [{"wait": "settled"},
      {"key": "S", "control": true, "shift": true}, {"key": "W"}, {"wait": 0.05},
      {"key": "S", "control": true, "shift": true}, {"key": "B"}, {"wait": 0.05},
      {"key": "R", "control": true}, {"wait": 0.05}, {"state": "one.json"},
      {"key": "R", "control": true}, {"wait": 0.05}, {"state": "two.json"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "names.json"});
  EXPECT_EQ(Json::parse(readBytes(path("one.json")))["wireframe"], false);
  EXPECT_EQ(Json::parse(readBytes(path("two.json")))["wireframe"], true);
  EXPECT_GT(fs::file_size(path("sphere.views/view 2.view.json")), 100u);
  EXPECT_EQ(Json::parse(readBytes(path("sphere.views/view 1.view.json")))["volume"],
            path("sphere.isb"));
  runWell({"render", "sphere.isb", "--state", "sphere.views/view 2.view.json", "--size", "90x60",
           "-o", "two.png"});
}

// The flat views beside the scene: a click sets where the slices cross, a drag with the right
// button black and white, the wheel the slice; the scene does not move.
TEST_F(ViewCommandTest, SlicesInViewsOfTheirOwn) {
  write("slices.json", R"({"size": [900, 600], "steps": [{"wait": "settled"},
      {"key": "TAB"}, {"state": "before.json"}, {"key": "U"}, {"wait": "settled"},
      {"click": [225, 143]}, {"wheel": 2}, {"wait": 0.05},
      {"drag": {"from": [225, 140], "to": [265, 140], "button": "right", "seconds": 0.1}},
      {"wait": "settled"}, {"frame": "slices.png"}, {"state": "after.json"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "slices.json"});
  const Json before = Json::parse(readBytes(path("before.json")));
  const Json after = Json::parse(readBytes(path("after.json")));
  EXPECT_EQ(after["slice_views"]["shown"], true);
  EXPECT_EQ(after["camera"], before["camera"]);
  EXPECT_EQ(after["focus"], before["focus"]);
  // The volume of 40 voxels is in the middle of 449 x 285 pixels.
  EXPECT_NEAR(after["slices"][0]["position"].get<double>(), 19.5, 1.0);
  EXPECT_NEAR(after["slices"][1]["position"].get<double>(), 19.5, 1.0);
  EXPECT_EQ(after["slices"][2]["position"].get<double>(),
            before["slices"][2]["position"].get<double>() + 2.0);
  const auto width = [](const Json& view) {
    return view["value_window"][1].get<double>() - view["value_window"][0].get<double>();
  };
  EXPECT_NEAR(width(after) / width(before), 1.1, 0.01);
}

// The view of another volume is another file than that of --state.
TEST_F(ViewCommandTest, AnotherVolumeLeavesTheViewOfTheFirst) {
  write("first.json", R"({"size": [300, 200], "steps": [{"wait": "settled"},
      {"state": "first.view.json"}, {"open": "phantom:gyroid:20"}, {"wait": "settled"},
      {"key": "S", "control": true}, {"wait": 0.05}]})");
  write("given.json", R"({"wireframe": true})");
  runWell({"view", "sphere.isb", "--state", "given.json", "--offscreen", "--script", "first.json"});
  EXPECT_EQ(readBytes(path("given.json")), R"({"wireframe": true})");
  EXPECT_EQ(Json::parse(readBytes(path("gyroid-20.view.json")))["volume"], "phantom:gyroid:20");
}

// Two orders, another volume and the end of the script: both are written.
TEST_F(ViewCommandTest, NoMeshIsLostInSilence) {
  write("meshes.json", R"({"size": [300, 200], "steps": [{"wait": "settled"},
      {"key": "M"}, {"key": "M"}, {"mesh": "third.ply"}, {"open": "phantom:gyroid:20"},
      {"key": "Q", "control": true}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "meshes.json"});
  const std::string mesh = readBytes(path("third.ply"));
  EXPECT_GT(mesh.size(), 1000u);
  EXPECT_EQ(readBytes(path("sphere-0001.ply")), mesh);
  EXPECT_EQ(readBytes(path("sphere-0002.ply")), mesh);
}

// Minimised, and something always moves.
TEST_F(ViewCommandTest, AWindowWithoutAPictureLeavesTheProcessorAlone) {
  write("hidden.json", R"({"size": [300, 200], "steps": [{"wait": "settled"}, {"key": "G"},
      {"key_press": "W"}, {"resize": [0, 0]}, {"wait": 1}]})");
  runWell(
      {"view", "sphere.isb", "--offscreen", "--script", "hidden.json", "--report", "report.json"});
  const Json report = Json::parse(readBytes(path("report.json")));
  int hidden = 0;
  for (const Json& frame : report["each_frame"])
    hidden += frame["seconds"] > report["seconds"].get<double>() - 1.0 ? 1 : 0;
  EXPECT_GT(hidden, 1);
  EXPECT_LE(hidden, 60);  // as many as a screen shows at most
}

TEST_F(ViewCommandTest, MeshFilesAreSimplifiedIfTheViewSaysSo) {
  write("meshes.json", R"({"size": [160, 120], "steps": [
      {"wait": "settled"}, {"mesh": "whole.ply"}, {"wait": "settled"},
      {"set": {"mesh_distance": 2}}, {"mesh": "simplified.ply"}, {"wait": "settled"}]})");
  runWell({"view", "sphere.isb", "--offscreen", "--script", "meshes.json", "--out-dir", "frames"});
  const auto whole = fs::file_size(path("frames/whole.ply"));
  const auto simplified = fs::file_size(path("frames/simplified.ply"));
  EXPECT_GT(simplified, 1000u);
  EXPECT_LT(simplified, whole * 9 / 10);
}

TEST_F(ViewCommandTest, RubbishToBeginWithIsOneLine) {
  write("rubbish", std::string(5000, 'x'));
  const std::set<std::string> before = files();
  checkFailure(run({"view", "rubbish", "--offscreen", "--script", "script.json"}), 1, "'");
  std::set<std::string> after = files();
  after.erase(".");
  EXPECT_EQ(after, before);
}

// The child ends with its window, and nothing half-written has its name.
TEST_F(ViewCommandTest, CtrlCEndsABuild) {
  write("wait.json", R"({"size": [120, 90], "steps": [{"wait": "settled"}]})");
  fs::create_directory(path("place"));
  const pid_t viewer =
      start({"/usr/bin/env", "XDG_RUNTIME_DIR=" + path("place"), isobrickCommand(), "view",
             "phantom:head:600", "--offscreen", "--preview-share", "1", "--script", "wait.json"});
  const auto unfinished = [&]() -> std::string {
    std::error_code no_folder;
    for (const auto& file : fs::directory_iterator(log_.file("cache/isobrick"), no_folder))
      if (file.path().extension() == ".partial") return file.path().string();
    return {};
  };
  std::string partial;
  while (partial.empty()) {
    partial = unfinished();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  kill(viewer, SIGINT);
  checkFailure(wait(viewer), 130, "interrupted");
  EXPECT_FALSE(fs::exists(fs::path(partial).replace_extension()));
  EXPECT_TRUE(fs::is_empty(path("place")));
  // Nobody writes any longer: another build of the same name is not refused for that.
  std::error_code ignored;
  const auto size = fs::exists(partial) ? fs::file_size(partial, ignored) : 0;
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(fs::exists(partial) ? fs::file_size(partial, ignored) : 0, size);
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
}

}  // namespace
}  // namespace isobrick::test
