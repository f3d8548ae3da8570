// `isobrick render --frames`: turntables, paths from view to view, movies, and sizes of prints.
#include <cstdint>
#include <cstdlib>
#include <fstream>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class RenderSequenceTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "48", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
  void TearDown() override { setenv("PATH", before_.c_str(), 1); }

  Outcome render(Words more) {
    Words words{"render", "head.isb", "--iso", "500", "--size", "64x48"};
    words.insert(words.end(), more.begin(), more.end());
    return run(words);
  }
  void renderWell(Words more) {
    const Outcome outcome = render(std::move(more));
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
  }
  // A program in place of ffmpeg, in a folder of its own in front of the others.
  void putFfmpeg(const std::string& script) {
    const std::string file = log_.file("ffmpeg");
    std::ofstream(file) << "#!/bin/sh\n" << script;
    fs::permissions(file, fs::perms::owner_all);
    setenv("PATH", (log_.path() + ":" + before_).c_str(), 1);
  }
  void writeView(const std::string& name, double azimuth) {
    Json view = Json::object();
    view["camera"] = {{"pivot", {23.5, 23.5, 23.5}}, {"distance", 120.0}, {"azimuth", azimuth}};
    view["surfaces"] = {{{"isovalue", 500.0}}};
    view["focus"] = {{"everywhere", true}};
    std::ofstream(path(name)) << view;
  }

  const std::string before_ = std::getenv("PATH");
};

TEST_F(RenderSequenceTest, ATurntableIsAFolderOfDifferentPictures) {
  renderWell({"--frames", "4", "-o", "turn/%03d.png"});
  std::set<std::string> pictures;
  for (const char* name : {"turn/001.png", "turn/002.png", "turn/003.png", "turn/004.png"})
    pictures.insert(readBytes(path(name)));
  EXPECT_EQ(pictures.size(), 4u);
  EXPECT_FALSE(fs::exists(path("turn/005.png")));
  // Half a turn further on it is the same as from there.
  renderWell({"--frames", "2", "--azimuth", "205", "-o", "half/%d.png"});
  EXPECT_EQ(readBytes(path("half/1.png")), readBytes(path("turn/003.png")));
  EXPECT_EQ(readBytes(path("half/2.png")), readBytes(path("turn/001.png")));
}

TEST_F(RenderSequenceTest, NothingIsReplacedUnlessAsked) {
  renderWell({"--frames", "3", "-o", "turn/%d.png"});
  EXPECT_EQ(render({"--frames", "2", "-o", "turn/%d.png"}).status, 1);
  EXPECT_TRUE(fs::exists(path("turn/3.png")));
  renderWell({"--frames", "2", "-o", "turn/%d.png", "--force"});
  EXPECT_FALSE(fs::exists(path("turn/3.png")));
  std::ofstream(path("turn/notes.txt")) << "mine";
  const Outcome refused = render({"--frames", "2", "-o", "turn/%d.png", "--force"});
  checkFailure(refused, 1, "something else");
  EXPECT_TRUE(fs::exists(path("turn/notes.txt")));
}

TEST_F(RenderSequenceTest, APathGoesFromViewToView) {
  writeView("a.json", 0.0);
  writeView("b.json", 90.0);
  runWell({"render", "head.isb", "--state", "a.json", "--state", "b.json", "--frames", "3",
           "--size", "64x48", "-o", "path/%d.png"});
  writeView("middle.json", 45.0);
  int number = 0;
  for (const char* view : {"a.json", "middle.json", "b.json"}) {
    runWell({"render", "head.isb", "--state", view, "--size", "64x48", "-o", "one.png", "--force"});
    EXPECT_EQ(readBytes(path("one.png")),
              readBytes(path("path/" + std::to_string(++number) + ".png")))
        << view;
  }
  runWell({"render", "head.isb", "--state", "a.json", "--frames", "8", "--size", "64x48", "-o",
           "turn/%d.png"});
  EXPECT_EQ(readBytes(path("turn/3.png")), readBytes(path("path/3.png")));
}

// The program gets all pictures, one after the other, and its file gets the name.
TEST_F(RenderSequenceTest, AMovieIsMadeByFfmpeg) {
  putFfmpeg(R"(echo "$@" > )" + log_.file("words") + R"(
while [ $# -gt 1 ]; do [ "$1" = -i ] && in="${2#file:}"; shift; done
cat "$in" > "${1#file:}"
)");
  renderWell({"--frames", "3", "--fps", "12.5", "-o", "turn.mp4"});
  renderWell({"--frames", "3", "-o", "turn/%d.png"});
  EXPECT_EQ(readBytes(path("turn.mp4")), readBytes(path("turn/1.png")) +
                                             readBytes(path("turn/2.png")) +
                                             readBytes(path("turn/3.png")));
  EXPECT_NE(readBytes(log_.file("words")).find("-framerate 12.5"), std::string::npos);
  EXPECT_EQ(render({"--frames", "3", "-o", "turn.mp4"}).status, 1);  // it exists
  EXPECT_EQ(files(), (std::set<std::string>{"head.isb", "head.nrrd", "turn", "turn.mp4",
                                            "turn/1.png", "turn/2.png", "turn/3.png"}));
}

TEST_F(RenderSequenceTest, WithoutAMovieNothingRemains) {
  const Words words{"render", "head.isb", "--iso", "500", "--size",
                    "64x48",  "--frames", "2",     "-o",  "m.mp4"};
  putFfmpeg("echo 'Unknown encoder' >&2; exit 1\n");
  expectFailure(1, words, "Unknown encoder");
  setenv("PATH", work_.path().c_str(), 1);
  expectFailure(1, words, "ffmpeg");
}

TEST_F(RenderSequenceTest, WrongUseSaysWhatIsMissing) {
  const auto expect = [&](const Words& more, const std::string& message) {
    Words words{"render", "head.isb", "--iso", "500"};
    words.insert(words.end(), more.begin(), more.end());
    const int status = message == "folder of their own" ? 1 : 2;
    expectFailure(status, words, message);
  };
  expect({"-o", "turn/%d.png"}, "--frames");
  expect({"-o", "turn.mp4"}, "--frames");
  expect({"-o", "turn.png", "--frames", "1"}, "--frames");
  expect({"-o", "turn%d.png", "--frames", "4"}, "folder of their own");
  expect({"-o", "a.png", "--frames", "4"}, "folder of their own");
  expect({"-o", "t/%d.png", "--frames", "4", "--eye", "0,-99,0", "--look-at", "24,24,24"},
         "--look-at");
  expect({"-o", "a.png", "--fps", "9"}, "--frames");
  expect({"-o", "a.png", "--size", "0x5mm"}, "millimetres");
  expect({"-o", "a.png", "--dpi", "0"}, "--dpi");
  writeView("a.json", 0.0);
  expectFailure(2, {"render", "head.isb", "--state", "a.json", "--state", "a.json", "-o", "a.png"},
                "--frames");
}

// Width, height and pixels per metre of a PNG file; 0 without them.
struct PngSize {
  std::uint32_t width, height, per_metre;
  bool operator==(const PngSize&) const = default;
};
PngSize pngSizeOf(const std::string& bytes) {
  const auto number = [&](std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i)
      value = value << 8 | static_cast<unsigned char>(bytes.at(at + i));
    return value;
  };
  const std::size_t print = bytes.find("pHYs");
  return {number(16), number(20), print == std::string::npos ? 0 : number(print + 4)};
}

TEST_F(RenderSequenceTest, PrintsHaveTheirSizeInMillimetres) {
  const auto sizeOf = [&](Words more) {
    Words words{"render", "head.isb", "--iso", "500", "-o", "a.png", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    runWell(words);
    return pngSizeOf(readBytes(path("a.png")));
  };
  // 25.4 mm are an inch: 300 pixels, or 11,811 a metre.
  EXPECT_EQ(sizeOf({"--size", "25.4x12.7mm"}), (PngSize{300, 150, 11811}));
  EXPECT_EQ(sizeOf({"--size", "25.4x12.7mm", "--dpi", "100"}), (PngSize{100, 50, 3937}));
  EXPECT_EQ(sizeOf({"--size", "60x40", "--dpi", "72"}), (PngSize{60, 40, 2835}));
  EXPECT_EQ(sizeOf({"--size", "60x40"}), (PngSize{60, 40, 0}));
}

TEST_F(RenderSequenceTest, ABackgroundHasAName) {
  const auto picture = [&](const Words& more) {
    Words words{"render", "head.isb", "--iso", "500", "--size", "48x48", "-o", "a.png", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    runWell(words);
    return readBytes(path("a.png"));
  };
  EXPECT_EQ(picture({"--background", "dark"}), picture({}));
  EXPECT_EQ(picture({"--background", "white"}), picture({"--background", "1,1,1"}));
  EXPECT_NE(picture({"--background", "light"}), picture({"--background", "white"}));
  EXPECT_NE(picture({"--ambient-occlusion"}), picture({}));
  expectFailure(2, {"render", "head.isb", "--iso", "500", "-o", "b.png", "--background", "rose"},
                "rose");
}

}  // namespace
}  // namespace isobrick::test
