// `--inside`, and where meshes lie: the words of the command, on all its ways to a mesh.
#include <glm/geometric.hpp>

#include "tests/support/command_test.h"
#include "tests/support/ply_reader.h"
#include "tests/support/vdb_file.h"

namespace isobrick::test {
namespace {

class InsideCommandTest : public CommandTest {
 protected:
  static constexpr double kRadius = 6, kSpacing = 0.5;

  void SetUp() override { writeVdbBall(path("ball.vdb"), kRadius, glm::dvec3(1, -2, 3), kSpacing); }
  double volumeOf(const std::string& name) const {
    const PlyMesh mesh = readPly(path(name));
    double volume = 0;
    for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
      const auto at = [&](std::size_t c) { return mesh.positions[mesh.triangles[i + c]]; };
      volume += glm::dot(at(0), glm::cross(at(1), at(2))) / 6;
    }
    return volume;
  }
  // Of the ball's mesh with these words, straight from the file, and of a pyramid.
  void expectVolume(double sign, const Words& words) {
    for (const char* input : {"ball.vdb", "ball.isb"}) {
      Words all = {"extract", input, "--iso", "0", "-o", "m.ply", "--force"};
      all.insert(all.end(), words.begin(), words.end());
      runWell(all);
      const double right = sign * 4.0 / 3 * M_PI * std::pow(kRadius, 3);
      EXPECT_NEAR(volumeOf("m.ply"), right, 0.02 * std::abs(right)) << input;
    }
  }
};

TEST_F(InsideCommandTest, ALevelSetSaysItsSide) {
  run({"build", "ball.vdb", "-o", "ball.isb"});
  expectVolume(-1, {});
  expectVolume(-1, {"--inside", "above"});
  expectVolume(1, {"--inside", "below"});
  expectVolume(1, {"--inside", "auto"});
  const Json json =
      runForJson({"extract", "ball.isb", "--iso", "0", "--inside", "auto", "--components"});
  EXPECT_GT(json["components"][0]["volume"], 0);
  runWell({"phantom", "sphere", "--voxels", "20", "-o", "bright.nrrd"});
  runWell({"extract", "bright.nrrd", "--iso", "0", "--inside", "auto", "-o", "auto.ply"});
  runWell({"extract", "bright.nrrd", "--iso", "0", "-o", "above.ply"});
  EXPECT_EQ(readBytes(path("auto.ply")), readBytes(path("above.ply")));
  EXPECT_EQ(run({"extract", "ball.vdb", "--iso", "0", "--inside", "left"}).status, 2);
}

TEST_F(InsideCommandTest, AMergeTakesThePlacementOfOneRun) {
  runWell({"phantom", "head", "--voxels", "48", "-o", "head.nrrd"});
  runWell({"build", "head.nrrd", "--brick", "16"});
  for (const char* number : {"1", "2"})
    runWell({"extract", "head.isb", "--iso", "900", "--inside", "below", "--part",
             std::string(number) + "/2", "-o", std::string(number) + ".isbm"});
  for (const std::string ending : {".ply", ".3mf", ".stl"}) {
    runWell({"merge", "1.isbm", "2.isbm", "--space", "RAS", "--shift", "1,2,3", "-o",
             "merged" + ending});
    run({"extract", "head.isb", "--iso", "900", "--inside", "below", "--space", "RAS", "--shift",
         "1,2,3", "-o", "whole" + ending});
    EXPECT_TRUE(readBytes(path("merged" + ending)) == readBytes(path("whole" + ending))) << ending;
  }
  for (const Words& words : {Words{"--space", "RAS"}, Words{"--unit", "mm"}, Words{"--together"}}) {
    Words share = {"extract", "head.isb", "--iso", "900", "--part", "1/2", "-o", "new.isbm"};
    share.insert(share.end(), words.begin(), words.end());
    expectFailure(2, share, words[0] + " does not go with a share");
    Words folder = {"extract", "head.isb", "--iso", "900", "-o", "new.precomputed"};
    folder.insert(folder.end(), words.begin(), words.end());
    expectFailure(2, folder, words[0] + " does not go with a .precomputed");
  }
}

TEST_F(InsideCommandTest, UnitsAreSaidAndRefused) {
  runWell({"phantom", "sphere", "--voxels", "20", "-o", "unknown.nrrd"});
  std::string header = readBytes(path("unknown.nrrd"));
  header.replace(header.find("\"\" \"\" \"\""), 8, "\"mm\" \"mm\" \"mm\"");
  writeBytes(path("known.nrrd"), header);
  const Json json = runForJson({"extract", "known.nrrd", "--iso", "0", "--unit", "inch", "--space",
                                "RAS", "--shift", "auto", "-o", "m.ply"});
  EXPECT_EQ(json["unit"], "inch");
  EXPECT_EQ(json["space"], "RAS");
  EXPECT_NE(readBytes(path("m.ply")).find("units: inches\ncomment space: RAS\ncomment shift: "),
            std::string::npos);
  expectFailure(1, {"extract", "unknown.nrrd", "--iso", "0", "--unit", "mm", "-o", "u.ply"},
                "the unit of the volume is unknown");
  expectFailure(
      1, {"extract", "known.nrrd", "--iso", "0", "--unit", "mm", "--space", "index", "-o", "u.ply"},
      "voxel indices have no unit");
  expectFailure(1, {"extract", "known.nrrd", "--iso", "0", "--unit", "nm", "-o", "u.3mf"},
                "a .3mf has no nanometres");
  EXPECT_EQ(run({"extract", "known.nrrd", "--iso", "0", "-o", "known.3mf"}).err, "");
  const std::string told = run({"extract", "unknown.nrrd", "--iso", "0", "-o", "unknown.3mf"}).err;
  EXPECT_NE(told.find("they count as millimetres\n"), std::string::npos) << told;
}

TEST_F(InsideCommandTest, AllSurfacesGoIntoOneFile) {
  runWell({"phantom", "head", "--voxels", "48", "-o", "head.nrrd"});
  runWell({"build", "head.nrrd"});
  for (const std::string ending : {".glb", ".3mf"}) {
    const Words words = {"--iso",   "500,1324",    "--together", "--color", "1,0,0",
                         "--color", "0.9,0.9,0.8", "--space",    "RAS"};
    for (const std::string input : {"head.nrrd", "head.isb"}) {
      Words all = {"extract", input, "-o", input + ending};
      all.insert(all.end(), words.begin(), words.end());
      run(all);
    }
    const std::string bytes = readBytes(path("head.isb" + ending));
    EXPECT_GT(bytes.size(), 10000u);
    EXPECT_TRUE(bytes == readBytes(path("head.nrrd" + ending))) << ending;
    if (ending == ".glb") {
      EXPECT_NE(bytes.find("\"name\":\"isovalue 1324\""), std::string::npos);
      EXPECT_NE(bytes.find("\"baseColorFactor\":[1.0,0.0,0.0,1]"), std::string::npos);
    }
  }
  EXPECT_FALSE(fs::exists(path("head.isb-500.glb")));
  expectFailure(1, {"extract", "head.isb", "--iso", "500,900", "--together", "-o", "a.ply"},
                "write .glb or .3mf");
  expectFailure(
      2,
      {"extract", "head.isb", "--iso", "500,900", "--together", "--color", "1,0,0", "-o", "a.glb"},
      "once for each isovalue");
}

}  // namespace
}  // namespace isobrick::test
