// `isobrick render` of pictures that no card draws in one piece.
#include <sys/resource.h>

#include <array>
#include <chrono>
#include <csignal>
#include <fstream>
#include <thread>

#include "isobrick/viewer/stream/plane_sampler.h"
#include "tests/support/command_test.h"
#include "tests/support/png_reader.h"
#include "tests/support/requirement.h"

namespace isobrick::test {
namespace {

class LargeRenderTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "sphere", "--voxels", "40", "-o", "sphere.mhd"});
    runWell({"build", "sphere.mhd"});
  }
  void write(const std::string& name, const std::string& text) {
    std::ofstream(path(name)) << text;
  }
};

TEST_F(LargeRenderTest, APictureMayBeLargerThanAnyCardDraws) {
  runWell({"render", "sphere.isb", "--iso", "0", "--size", "40000x60", "--scale-bar", "-o",
           "wide.png"});
  const PictureBytes wide = readPng(path("wide.png"), 40000);
  EXPECT_EQ(wide.width, 40000);
  EXPECT_EQ(wide.height, 60);
  // The ball in the middle, and the background at both ends.
  const auto pixel = [&](int x, int y) {
    const std::size_t at = wide.offsetOf(x, y);
    return std::array{wide.rgba[at], wide.rgba[at + 1], wide.rgba[at + 2]};
  };
  EXPECT_NE(pixel(20000, 30), pixel(100, 30));
  EXPECT_EQ(pixel(39000, 30), pixel(100, 30));
  expectFailure(2, {"render", "sphere.isb", "--iso", "0", "--size", "500001x10", "-o", "a.png"},
                "500000");
}

// In one piece it would take 1.3 GB.
TEST_F(LargeRenderTest, APosterTakesTheMemoryOfABand) {
  for (const char* name : {"poster.png", "poster.exr"})
    runWell({"render", "sphere.isb", "--iso", "0", "--size", "4000x4000", "-o", name});
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they keep what was freed
  rusage usage{};
  getrusage(RUSAGE_CHILDREN, &usage);
  EXPECT_LT(usage.ru_maxrss, 600'000);  // KiB, of the greatest of these runs
#endif
  const PictureBytes poster = readPng(path("poster.png"), 4000);
  EXPECT_EQ(poster.height, 4000);
  EXPECT_GT(fs::file_size(path("poster.exr")), 1000u);
}

// Whatever was drawn by then.
TEST_F(LargeRenderTest, AnInterruptLeavesNothing) {
  const std::set<std::string> before = files();
  for (const char* name : {"poster.png", "poster.exr"}) {
    const pid_t pid = start({isobrickCommand(), "render", "sphere.isb", "--iso", "0", "--size",
                             "60000x40000", "-o", name});
    for (int i = 0; i < 600 && files() == before; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    EXPECT_NE(files(), before);
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    kill(pid, SIGINT);
    const Outcome outcome = wait(pid);
    EXPECT_EQ(outcome.status, 130);
    EXPECT_NE(outcome.err.find("interrupted"), std::string::npos) << outcome.err;
    EXPECT_EQ(files(), before);
  }
}

// The window's picture has a surface of its own, as fine as the picture can show.
TEST_F(LargeRenderTest, APictureOfTheWindowIsTheOneOfItsState) {
  write("pictures.json", R"({"size": [160, 120], "steps": [
      {"set": {"view_pixels": 8, "focus": {"everywhere": true}, "pictures": {"times": 4},
               "slices": [{}, {}, {"shown": true, "position": 20}]}},
      {"wait": "settled"},
      {"state": "view.json"}, {"picture": "large.png"}, {"picture": "large.exr"},
      {"wait": "settled"},
      {"set": {"pictures": {"times": 1}}}, {"wait": "settled"}, {"picture": "small.png"}]})");
  runWell(
      {"view", "sphere.isb", "--offscreen", "--script", "pictures.json", "--out-dir", "frames"});
  const std::string fine = runWell({"render", "sphere.isb", "--state", "frames/view.json", "--size",
                                    "640x480", "-o", "same.png"});
  runWell({"render", "sphere.isb", "--state", "frames/view.json", "--size", "640x480", "-o",
           "same.exr"});
  ASSERT_FALSE(readBytes(path("same.png")).empty());
  EXPECT_TRUE(readBytes(path("frames/large.png")) == readBytes(path("same.png")));
  EXPECT_TRUE(readBytes(path("frames/large.exr")) == readBytes(path("same.exr")));
  const std::string coarse = runWell({"render", "sphere.isb", "--state", "frames/view.json",
                                      "--size", "160x120", "-o", "small.png"});
  EXPECT_TRUE(readBytes(path("frames/small.png")) == readBytes(path("small.png")));
  // The window's surface is another one: its cells are larger.
  const auto triangles = [](const std::string& line) {
    const std::size_t end = line.find(" triangles");
    return line.substr(line.rfind(' ', end - 1), end - line.rfind(' ', end - 1));
  };
  EXPECT_NE(triangles(fine), triangles(coarse));
}

// The view changes while its picture is drawn, and the window goes on.
TEST_F(LargeRenderTest, APictureIsThatOfTheMomentItWasOrdered) {
  write("pictures.json", R"({"size": [160, 120], "steps": [
      {"set": {"pictures": {"times": 16}}}, {"wait": "settled"},
      {"state": "view.json"}, {"picture": "large.png"}, {"lose_context": true},
      {"sweep": {"isovalue": [0, 4], "seconds": 0.3}}, {"wait": "settled"}]})");
  runWell(
      {"view", "sphere.isb", "--offscreen", "--script", "pictures.json", "--out-dir", "frames"});
  runWell({"render", "sphere.isb", "--state", "frames/view.json", "--size", "2560x1920", "-o",
           "same.png"});
  EXPECT_TRUE(readBytes(path("frames/large.png")) == readBytes(path("same.png")));
}

}  // namespace
}  // namespace isobrick::test
