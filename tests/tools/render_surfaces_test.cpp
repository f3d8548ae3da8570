// `isobrick render` of several surfaces, and of a part of one.
#include <cstdlib>

#include "tests/support/command_test.h"
#include "tests/support/png_reader.h"

namespace isobrick::test {
namespace {

class RenderSurfacesTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "48", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
  // From one place, whatever is drawn.
  std::string rendered(const Words& more) {
    Words words = {"render",    "head.isb",    "--size",   "96x96",    "--eye",
                   "24,-60,24", "--look-at",   "24,24,24", "--pixels", "0.01",
                   "-o",        "picture.png", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return readBytes(path("picture.png"));
  }
};

TEST_F(RenderSurfacesTest, EachHasItsColorAndOpacity) {
  const std::string inner = rendered({"--iso", "1160", "--color", "0.2,0.4,0.9"});
  const std::string hidden = rendered({"--iso", "530,1160", "--color", "0.9,0.6,0.5", "--color",
                                       "0.2,0.4,0.9", "--opacity", "0", "--opacity", "1"});
  EXPECT_TRUE(hidden == inner);
  const std::string both = rendered({"--iso", "530,1160", "--color", "0.9,0.6,0.5", "--color",
                                     "0.2,0.4,0.9", "--opacity", "0.4", "--opacity", "1"});
  const std::string outer = rendered({"--iso", "530", "--color", "0.9,0.6,0.5"});
  EXPECT_FALSE(both == inner);
  EXPECT_FALSE(both == outer);
  expectFailure(2, {"render", "head.isb", "--iso", "530,1160", "--opacity", "0.4", "-o", "b.png"},
                "once for each isovalue");
  EXPECT_EQ(run({"render", "head.isb", "--iso", "530", "--opacity", "2", "-o", "b.png"}).status, 2);
}

TEST_F(RenderSurfacesTest, FewerTrianglesAndPieces) {
  const auto trianglesOf = [&](const Words& more) {
    Words words = {"render", "head.isb", "--iso", "1324",   "--size",
                   "32x32",  "-o",       "p.png", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    std::string out = run(words).out;
    std::erase(out, ',');
    return std::stoull(out.substr(out.find("pixels") + 6));
  };
  const Words extract = {"extract", "head.isb", "--iso", "1324"};
  const auto extracted = [&](const Words& more) {
    Words words = extract;
    words.insert(words.end(), more.begin(), more.end());
    return runForJson(words)["triangles"].get<std::uint64_t>();
  };
  for (const Words& more : {Words{}, Words{"--simplify", "0.5"}, Words{"--keep-largest", "1"}})
    EXPECT_EQ(trianglesOf(more), extracted(more));
}

// The same head in voxels of half the size, somewhere else: in the world they stand side by side.
TEST_F(RenderSurfacesTest, VolumesShareOneWorld) {
  runWell({"build", "head.nrrd", "--spacing", "0.5,0.5,0.5", "--origin", "48,12,12", "-o",
           "small.isb"});
  const auto pictureOf = [&](const Words& files) {
    Words words{"render"};
    words.insert(words.end(), files.begin(), files.end());
    words.insert(words.end(), {"--size", "96x64", "--eye", "36,-90,24", "--look-at", "36,24,24",
                               "-o", "p.png", "--force"});
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return readPng(path("p.png"), 96);
  };
  const Words colors{"--color", "0.9,0.2,0.2", "--color", "0.2,0.9,0.2"};
  const PictureBytes head = pictureOf({"head.isb", "--iso", "1160", "--color", "0.9,0.2,0.2"});
  const PictureBytes small = pictureOf({"small.isb", "--iso", "530", "--color", "0.2,0.9,0.2"});
  Words words{"head.isb", "small.isb", "--iso", "1160", "--iso", "530"};
  words.insert(words.end(), colors.begin(), colors.end());
  const PictureBytes both = pictureOf(words);
  // Where one of them is alone, it is as it is alone: neither hides the other from here.
  const PictureBytes background = pictureOf({"head.isb", "--iso", "1e9", "--color", "1,1,1"});
  std::size_t of_head = 0, of_small = 0, others = 0;
  for (std::size_t i = 0; i < both.rgba.size(); i += 4) {
    const auto same = [&](const PictureBytes& a, const PictureBytes& b) {
      for (std::size_t c = 0; c < 3; ++c)
        if (std::abs(int{a.rgba[i + c]} - int{b.rgba[i + c]}) > 8) return false;
      return true;
    };
    const bool is_head = !same(head, background), is_small = !same(small, background);
    of_head += is_head ? 1 : 0;
    of_small += is_small ? 1 : 0;
    if (!same(both, is_head ? head : small)) ++others;
  }
  EXPECT_GT(of_head, 200u);
  EXPECT_GT(of_small, 50u);
  EXPECT_LE(others, 12u);  // at their borders
}

TEST_F(RenderSurfacesTest, StepsOfTimeAreOnePictureEach) {
  runWell({"phantom", "sphere", "--voxels", "48", "-o", "sphere.nrrd"});
  runWell({"build", "sphere.nrrd"});
  const Words look{"--steps", "--iso", "0", "--size", "64x64"};
  const auto renderSteps = [&](const std::string& output) {
    Words words{"render", "head.isb", "sphere.isb", "-o", output};
    words.insert(words.end(), look.begin(), look.end());
    return run(words);
  };
  EXPECT_EQ(renderSteps("steps/%02d.png").status, 0);
  EXPECT_EQ(renderSteps("step-{name}.png").status, 0);
  EXPECT_EQ(readBytes(path("steps/01.png")), readBytes(path("step-head.png")));
  EXPECT_EQ(readBytes(path("steps/02.png")), readBytes(path("step-sphere.png")));
  EXPECT_NE(readBytes(path("steps/01.png")), readBytes(path("steps/02.png")));
  EXPECT_EQ(renderSteps("steps/%02d.png").status, 1);  // in the way
  expectFailure(2, {"render", "head.isb", "--steps", "--iso", "0", "-o", "p.png"}, "several FILE");
  expectFailure(2,
                {"render", "head.isb", "sphere.isb", "--steps", "--iso", "0", "--frames", "3", "-o",
                 "p/%d.png"},
                "--frames");
}

}  // namespace
}  // namespace isobrick::test
