// The viewer within a test: drivers that fail in the middle of a frame.
#include "isobrick/viewer/window/view_loop.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/window/gl_target.h"
#include "tests/support/driver_faults.h"
#include "tests/support/file_bytes.h"
#include "tests/support/offscreen_view.h"
#include "tests/support/requirement.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

class ViewLoopTest : public ::testing::Test {
 protected:
  void SetUp() override {
    try {
      const EglContext probe;
    } catch (const Error& error) {
      SKIP_UNLESS_REQUIRED(error.what());
    }
    options_ = test::offscreenView(folder_);
    run(R"({"wait": "settled"}, {"picture": "found.png"})");  // see DriverFaults
  }
  void run(const std::string& steps) {
    std::ofstream(options_.script_path) << R"({"size": [200, 150], "steps": [)" << steps << "]}";
    runView(options_);
  }
  std::string file(const char* name) const { return test::readBytes(folder_.file(name)); }

  test::TemporaryFolder folder_;
  ViewOptions options_;
};

// At any moment at which the driver is asked: at the begin of a frame, and after errors of uploads
// and drawing.
TEST_F(ViewLoopTest, AResetInTheMiddleOfAFrameEndsNothing) {
  for (const int asks : {1, 2, 5}) {
    test::DriverFaults driver;
    driver.reset(asks);
    const std::string name = "after-" + std::to_string(asks) + ".png";
    run(R"({"wait": "settled"}, {"sweep": {"isovalue": [2, 6], "seconds": 0.1}},
        {"wait": "settled"}, {"picture": ")" +
        name + R"("})");
    EXPECT_EQ(driver.resets(), 1);
  }
  EXPECT_EQ(file("after-1.png"), file("after-2.png"));
  EXPECT_EQ(file("after-1.png"), file("after-5.png"));
}

TEST_F(ViewLoopTest, AnErrorOfADrawingIsShownAndTheNextFrameDraws) {
  run(R"({"wait": "settled"}, {"picture": "before.png"})");
  test::FailingDraws driver(GL_OUT_OF_MEMORY, 3, 140);  // beside the panel; fewer than steps
  run(R"({"wait": 0.2}, {"resize": [300, 200]}, {"wait": 0.1}, {"resize": [200, 150]},
      {"wait": "settled"}, {"picture": "after.png"})");
  EXPECT_EQ(driver.failures(), 3);
  EXPECT_EQ(file("before.png"), file("after.png"));
}

// A context that is lost in a drawing: the error comes first, and the reset is its reason.
TEST_F(ViewLoopTest, ALossWhileItDrawsIsNoWantOfMemory) {
  run(R"({"wait": "settled"}, {"picture": "before.png"})");
  test::FailingDraws driver(0x0507, 2);  // GL_CONTEXT_LOST
  run(R"({"wait": "settled"}, {"picture": "after.png"})");
  EXPECT_EQ(driver.failures(), 2);
  EXPECT_EQ(file("before.png"), file("after.png"));
}

// The script's file is written when all is there again.
TEST_F(ViewLoopTest, APictureThatALossInterruptsIsWrittenAfterIt) {
  const char kSteps[] = R"({"set": {"pictures": {"times": 3}}}, {"wait": "settled"},
      {"picture": "large.png"})";
  run(kSteps);
  const std::string whole = file("large.png");
  std::filesystem::remove(folder_.file("large.png"));
  test::FailingDraws driver(0x0507, 1, 600);
  run(kSteps);
  EXPECT_EQ(driver.failures(), 1);
  EXPECT_EQ(file("large.png"), whole);
}

// The panel goes away under a cursor that holds the scene.
TEST_F(ViewLoopTest, TabInADragMovesNothing) {
  run(R"({"resize": [900, 600]}, {"wait": "settled"}, {"press": "left"}, {"move": [600, 300]},
      {"press": "left"}, {"move": [610, 300]}, {"state": "before.json"}, {"key": "TAB"},
      {"move": [611, 300]}, {"release": "left"}, {"state": "after.json"})");
  const auto azimuth = [&](const char* name) {
    return nlohmann::json::parse(file(name))["camera"]["azimuth"].get<double>();
  };
  EXPECT_NEAR(azimuth("after.json"), azimuth("before.json"), 1.0);
  EXPECT_NE(azimuth("after.json"), azimuth("before.json"));
}

// A window that moves from one screen to another.
class MovedTarget : public EglTarget {
 public:
  MovedTarget(int width, int height, double first, double then)
      : EglTarget(width, height, first), first_(first), then_(then) {}
  double scale() const override { return has_moved ? then_ : first_; }

  bool has_moved = false;

 private:
  double first_, then_;
};

TEST_F(ViewLoopTest, OnAnotherScreenItLooksAsIfItHadBeenOpenedThere) {
  std::string screens[2];
  for (const double first : {2.0, 1.0}) {
    auto target = std::make_unique<MovedTarget>(900, 700, first, 2.0);
    MovedTarget& moved = *target;
    int frames = 0;
    std::ofstream(options_.script_path) << R"({"size": [900, 700], "steps": [
            {"set": {"ambient_occlusion": false, "camera": {"pivot": [20, 20, 20], "distance": 90}}},
            {"wait": "settled"}, {"key": "Z"}, {"wait": "settled"}, {"move": [700, 60]},
            {"wait": 1.0}, {"frame": "moved.png"}]})";
    runView(options_, {std::move(target), [&](ViewSession*, bool) {
                         moved.has_moved = moved.has_moved || ++frames > 3;
                       }});
    screens[first == 1.0 ? 1 : 0] = file("moved.png");
  }
  EXPECT_TRUE(screens[0] == screens[1]);
}

// Round and round, with all of them open or two: then others are opened meanwhile.
TEST_F(ViewLoopTest, StepsOfTimePlay) {
  for (const double radius : {6.0, 8.0, 10.0, 12.0, 14.0})
    options_.steps.push_back(test::buildField(
        folder_, Index3(32),
        [=](const glm::dvec3& p) { return radius - glm::distance(p, glm::dvec3(15.5)); }, {}, {},
        "run-" + std::to_string(options_.steps.size()) + ".isb"));
  options_.path = options_.steps.front();
  std::ofstream(options_.script_path) << R"({"size": [200, 150], "steps": [{"wait": "settled"},
      {"set": {"focus": {"everywhere": true}}}, {"key": "J"}, {"wait": "settled"},
      {"state": "playing.json"}, {"wait": 1e6}]})";
  for (const std::size_t most_open : {5u, 2u}) {
    options_.steps_open = most_open;
    CancelFlag done;
    options_.cancel = &done;
    std::map<std::string, std::set<const Pyramid*>> opened;
    std::vector<std::string> order;
    const auto watch = [&](ViewSession* session, bool settled) {
      const std::string& path = session->pyramid().path();
      if (order.empty() || order.back() != path) order.push_back(path);
      opened[path].insert(&session->pyramid());
      EXPECT_TRUE(order.size() == 1 || session->status().triangles > 0);
      if (order.size() <= 12) return;
      if (settled && !session->interaction().playing) done.request();
      session->interaction().playing = false;
    };
    EXPECT_THROW(runView(options_, {{}, watch}), Cancelled);
    EXPECT_TRUE(std::filesystem::remove(folder_.file("playing.json")));
    for (std::size_t i = 0; i < order.size(); ++i) EXPECT_EQ(order[i], options_.steps[i % 5]);
    if (most_open < 5) continue;
    for (const auto& [path, pyramids] : opened) EXPECT_EQ(pyramids.size(), 1u) << path;
  }
}

// Without a surface there is nothing to wait for, and undo works.
TEST_F(ViewLoopTest, AVolumeOfOneValueOpens) {
  options_.path = test::buildField(
      folder_, Index3(20), [](const glm::dvec3&) { return 7.0; }, {}, {}, "constant.isb");
  run(R"({"wait": "settled"}, {"key": "X"}, {"wait": 0.6}, {"key": "Y"}, {"wait": 0.6},
      {"key": "Z", "control": true}, {"state": "undone.json"},
      {"key": "Z", "control": true, "shift": true}, {"state": "redone.json"})");
  EXPECT_EQ(nlohmann::json::parse(file("undone.json"))["clip_planes"].size(), 1u);
  EXPECT_EQ(nlohmann::json::parse(file("redone.json"))["clip_planes"].size(), 2u);
}

}  // namespace
}  // namespace isobrick
