// `isobrick extract` and `render` of a part of a surface.
#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class RegionCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "48", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
  Json extracted(const char* input, const Words& more) {
    Words words = {"extract", input, "--iso", "900"};
    words.insert(words.end(), more.begin(), more.end());
    return runForJson(words);
  }
};

TEST_F(RegionCommandTest, PlanesAndSpheresCutInVoxelsOrInTheWorld) {
  const Json whole = extracted("head.isb", {});
  const Json half = extracted("head.isb", {"--clip", "1,0,0,24"});
  EXPECT_LT(half["triangles"], whole["triangles"]);
  EXPECT_GT(half["triangles"], 0);
  EXPECT_EQ(extracted("head.isb", {"--clip", "24,5,5,2,0,0"})["triangles"], half["triangles"]);
  // Straight from the volume, too.
  EXPECT_EQ(extracted("head.nrrd", {"--clip", "1,0,0,24"})["triangles"], half["triangles"]);
  const Json info = runForJson({"info", "head.isb"});
  const double x = info["origin"][0].get<double>() + 24 * info["spacing"][0].get<double>();
  const Json in_world = extracted("head.isb", {"--world", "--clip", "1,0,0," + std::to_string(x)});
  EXPECT_EQ(in_world["triangles"], half["triangles"]);
  const Json ball = extracted("head.isb", {"--sphere", "24,24,24,12", "--clip", "1,0,0,24"});
  EXPECT_LT(ball["triangles"], half["triangles"]);
  const Json solid = extracted("head.isb", {"--sphere", "24,24,24,12", "--cap", "--components"});
  for (const Json& one : solid["components"]) EXPECT_TRUE(one["volume"].is_number());
}

TEST_F(RegionCommandTest, LengthsHaveUnits) {
  expectFailure(1, {"extract", "head.isb", "--iso", "900", "--sphere", "0,0,0,5mm"},
                "that of the volume is unknown");
  for (const Words& place : {Words{"--input-unit", "um"}, {"--spacing", "0.5,0.5,0.5um"}}) {
    Words build = {"build", "head.nrrd", "-o", "um.isb", "--force", "--rebuild"};
    build.insert(build.end(), place.begin(), place.end());
    runWell(build);
    const Json info = runForJson({"info", "um.isb"});
    EXPECT_EQ(info["length_unit"], "millimetres");
    const auto at = [&](std::size_t axis, double index) {
      return 1e3 *
             (info["origin"][axis].get<double>() + index * info["spacing"][axis].get<double>());
    };
    const auto same = [&](const Words& in_voxels, const Words& in_world) {
      const Json cut = extracted("um.isb", in_voxels);
      EXPECT_GT(cut["triangles"], 100);
      EXPECT_LT(cut["triangles"], extracted("um.isb", {})["triangles"]);
      EXPECT_EQ(extracted("um.isb", in_world)["triangles"], cut["triangles"]);
    };
    const double step = 1e3 * info["spacing"][0].get<double>();
    const auto text = [](double number) { return std::to_string(number); };
    same({"--clip", "1,0,0,24.25"}, {"--clip", "1,0,0," + text(at(0, 24.25)) + "um"});
    const std::string middle =
        text(at(0, 20.1)) + "," + text(at(1, 23.3)) + "," + text(at(2, 24.7));
    same({"--clip", "20.1,23.3,24.7,1,1,0"}, {"--clip", middle + ",1,1,0um"});
    same({"--sphere", "20.1,23.3,24.7,15.3"},
         {"--sphere", middle + "," + text(15.3 * step) + "um"});
    same({"--focus", "20.1,23.3,24.7", "--radius", "9.3"},
         {"--focus", middle + "um", "--radius", text(9.3 * step) + "um"});
  }
}

TEST_F(RegionCommandTest, MasksAreVolumesOrPyramids) {
  // Half as many voxels, twice as large; 7 in half of them.
  std::string mask =
      "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 24 24 24\nencoding: raw\nspace dimension: 3\n"
      "space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (0.5,0.5,0.5)\n\n";
  for (int i = 0; i < 24 * 24 * 24; ++i) mask += i % 24 < 12 ? '\0' : '\7';
  writeBytes(path("mask.nrrd"), mask);
  const Json whole = extracted("head.isb", {});
  const Json half = extracted("head.isb", {"--mask", "mask.nrrd:7"});
  EXPECT_LT(half["triangles"], whole["triangles"]);
  EXPECT_GT(half["triangles"], 0);
  EXPECT_EQ(extracted("head.nrrd", {"--mask", "mask.nrrd:7"})["triangles"], half["triangles"]);
  EXPECT_EQ(extracted("head.isb", {"--mask", "mask.nrrd"})["triangles"], half["triangles"]);
  runWell({"build", "mask.nrrd"});
  EXPECT_EQ(extracted("head.isb", {"--mask", "mask.isb:7"})["triangles"], half["triangles"]);
  expectFailure(
      1,
      {"extract", "head.isb", "--iso", "900", "--mask", "mask.nrrd", "-o", "mask.nrrd", "--force"},
      "is the input");
}

TEST_F(RegionCommandTest, BadWordsAreRefusedInOneLine) {
  const std::vector<std::pair<Words, const char*>> bad = {
      {{"--clip", "1,0,0"}, "NX,NY,NZ,D"},
      {{"--clip", "0,0,0,1"}, "normal of 0,0,0"},
      {{"--sphere", "1,2,3,-4"}, "radius above 0"},
      {{"--mask", "nothing.nrrd:3"}, "nothing.nrrd"},
      {{"--sphere", "24,24,24,9", "--cap", "--level", "1"}, "level 0"}};
  for (const auto& [more, text] : bad) {
    Words words = {"extract", "head.isb", "--iso", "900"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = run(words);
    EXPECT_NE(outcome.status, 0);
    EXPECT_EQ(outcome.errorLines(), 1) << outcome.err;
    EXPECT_NE(outcome.err.find(text), std::string::npos) << outcome.err;
  }
}

}  // namespace
}  // namespace isobrick::test
