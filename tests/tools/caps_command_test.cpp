// `isobrick extract --cap`: a solid on every way to a mesh.
#include "tests/support/command_test.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/ply_reader.h"

namespace isobrick::test {
namespace {

class CapsCommandTest : public CommandTest {
 protected:
  void SetUp() override { runWell({"phantom", "head", "--voxels", "64", "-o", "head.nrrd"}); }
  MeshReport solidOf(const std::string& name) const {
    const PlyMesh mesh = readPly(path(name));
    return checkMesh(mesh.positions, mesh.triangles);
  }
  std::uint64_t capsOf(const Json& report) const {
    std::uint64_t caps = 0;
    for (const Json& level : report["levels"]) caps += level["cap_triangles"].get<std::uint64_t>();
    return caps;
  }
};

TEST_F(CapsCommandTest, AVolumeItsPyramidAndSharesGiveOneSolid) {
  const Words wanted = {"--iso", "900", "--cap"};
  const auto extract = [&](const std::string& from, const Words& more) {
    Words words = {"extract", from};
    words.insert(words.end(), wanted.begin(), wanted.end());
    words.insert(words.end(), more.begin(), more.end());
    return runForJson(words);
  };
  const Json streamed = extract("head.nrrd", {"-o", "streamed.ply"});
  EXPECT_GT(capsOf(streamed), 0u);
  const MeshReport solid = solidOf("streamed.ply");
  EXPECT_TRUE(solid.ok()) << solid.summary();
  EXPECT_GT(solid.volume, 0);
  runWell({"build", "head.nrrd", "--brick", "16"});
  extract("head.isb", {"--components", "-o", "pyramid.ply"});
  const Json listed = extract("head.isb", {"--components"});
  // The neck, too.
  for (const Json& one : listed["components"]) EXPECT_TRUE(one["volume"].is_number());
  for (const char* const part : {"1/2", "2/2"})
    extract("head.isb", {"--part", part, "-o", std::string("share") + part[0] + ".isbm"});
  runWell({"merge", "share1.isbm", "share2.isbm", "-o", "merged.ply"});
  extract("head.isb", {"-o", "whole.ply"});
  EXPECT_TRUE(readBytes(path("merged.ply")) == readBytes(path("whole.ply")));
  EXPECT_EQ(readBytes(path("pyramid.ply")).size(), readBytes(path("whole.ply")).size());

  // Without them it is open there, and has the same other triangles.
  const Json open = runForJson({"extract", "head.isb", "--iso", "900", "-o", "open.ply"});
  EXPECT_EQ(capsOf(open), 0u);
  EXPECT_EQ(open["triangles"].get<std::uint64_t>() + capsOf(listed), listed["triangles"]);
  EXPECT_GT(solidOf("open.ply").open_edges, 0);
}

TEST_F(CapsCommandTest, ABoxIsCutOutAndTheLargestPieceIsThatOfTheLargestVolume) {
  const Json report = runForJson({"extract", "head.nrrd", "--iso", "900", "--cap", "--box",
                                  "10,10,10,40,50,45", "--keep-largest", "1", "-o", "cut.ply"});
  EXPECT_EQ(report["ranked_by"], "volume");
  const MeshReport solid = solidOf("cut.ply");
  EXPECT_TRUE(solid.ok()) << solid.summary();
  EXPECT_GT(solid.volume, 0);
}

TEST_F(CapsCommandTest, SaysWhereItDoesNotGo) {
  runWell({"build", "head.nrrd"});
  expectFailure(2, {"extract", "head.isb", "--iso", "900", "--cap", "-o", "head.precomputed"},
                "--cap does not go with a .precomputed output");
  expectFailure(2, {"bench", "head.isb", "--iso", "900", "--cap"}, "leave out --cap");
}

}  // namespace
}  // namespace isobrick::test
