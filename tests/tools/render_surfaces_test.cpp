// `isobrick render` of several surfaces, and of a part of one.
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

}  // namespace
}  // namespace isobrick::test
