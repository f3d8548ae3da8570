// `isobrick extract` of a volume: straight from the file if a pyramid is no help.
#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class ExtractVolumeTest : public CommandTest {
 protected:
  void SetUp() override { runWell({"phantom", "head", "--voxels", "80", "-o", "head.nrrd"}); }

  bool hasCache() const { return fs::exists(std::string(getenv("XDG_CACHE_HOME")) + "/isobrick"); }
  // The mesh of the volume, and that of its pyramid.
  void expectSame(const Words& options, const std::string& ending = ".ply") {
    Words direct = {"extract", "head.nrrd", "-o", "direct" + ending, "--force"};
    direct.insert(direct.end(), options.begin(), options.end());
    runWell(direct);
    EXPECT_FALSE(hasCache());
    Words built = {"extract", "head.nrrd",      "--cache-folder", "named",
                   "-o",      "built" + ending, "--force"};
    built.insert(built.end(), options.begin(), options.end());
    runWell(built);
    EXPECT_TRUE(fs::exists(path("named")));
    EXPECT_EQ(readBytes(path("direct" + ending)), readBytes(path("built" + ending)));
  }
};

TEST_F(ExtractVolumeTest, IsWhatItIsOfThePyramid) {
  expectSame({"--iso", "1324"});
  expectSame({"--iso", "500", "--box", "5,5,5,60,70,62"});
  expectSame({"--iso", "500", "--simplify", "0.5", "--drop-small"}, ".stl");
  expectSame({"--iso", "1324", "--keep-largest", "1", "--attribute", "component"}, ".glb");
  runWell({"build", "head.nrrd", "-o", "other.isb"});
  expectSame({"--iso", "500", "--attribute", "other.isb", "--shift", "auto"}, ".vtp");
  expectSame({"--iso", "500", "--spacing", "1,2,3"});
  // A slab at a time; a pyramid takes 16 MiB.
  runWell({"extract", "head.nrrd", "--iso", "500", "--spacing", "1,2,3", "--memory", "3M", "-o",
           "small.ply"});
  EXPECT_EQ(readBytes(path("small.ply")), readBytes(path("direct.ply")));
}

TEST_F(ExtractVolumeTest, SeveralSurfacesTakeOnePass) {
  const Json json =
      runForJson({"extract", "head.nrrd", "--iso", "500,1324", "--components", "-o", "m.ply"});
  EXPECT_FALSE(hasCache());
  ASSERT_EQ(json["surfaces"].size(), 2u);
  for (const char* isovalue : {"500", "1324"}) {
    runWell({"extract", "head.nrrd", "--iso", isovalue, "-o", "alone.ply", "--force"});
    EXPECT_EQ(readBytes(path("m-" + std::string(isovalue) + ".ply")), readBytes(path("alone.ply")));
  }
  EXPECT_GT(json["surfaces"][0]["components"].size(), 0u);
}

TEST_F(ExtractVolumeTest, AQueryOfOtherLevelsBuildsThePyramid) {
  runWell({"extract", "head.nrrd", "--iso", "500", "--level", "1"});
  EXPECT_TRUE(hasCache());
}

TEST_F(ExtractVolumeTest, APyramidThatIsThereIsTaken) {
  runWell({"build", "head.nrrd"});
  const Json json = runForJson({"extract", "head.nrrd", "--iso", "500"});
  EXPECT_GT(json["bytes_read"].get<std::uint64_t>(), 0u);
  EXPECT_FALSE(hasCache());
}

TEST_F(ExtractVolumeTest, FailsAsAPyramidDoes) {
  expectFailure(1, {"extract", "head.nrrd", "--iso", "500", "-o", "head.nrrd", "--force"}, "input");
  expectFailure(2, {"extract", "head.nrrd", "--iso", "500", "--raw-dims", "3,4,5"}, "--raw-");
  expectFailure(1, {"extract", "absent.nrrd", "--iso", "500"}, "absent.nrrd");
  expectFailure(1, {"extract", "head.nrrd", "--iso", "500", "--box", "90,90,90,99,99,99"}, "--box");
  runWell({"extract", "head.nrrd", "--iso", "500", "-o", "a.ply"});
  expectFailure(1, {"extract", "head.nrrd", "--iso", "500", "-o", "a.ply"}, "a.ply");
  const Outcome empty = run({"extract", "head.nrrd", "--iso", "9000", "-o", "b.ply"});
  EXPECT_EQ(empty.status, 0);
  EXPECT_NE(empty.err.find("no surface at the isovalue 9000"), std::string::npos) << empty.err;
  EXPECT_NE(empty.err.find(" are 0 to "), std::string::npos) << empty.err;
  // Of the whole volume, though no voxel was looked at, or only some.
  const Outcome far = run({"extract", "head.nrrd", "--iso", "1e30", "--cache-folder", "named"});
  EXPECT_EQ(run({"extract", "head.nrrd", "--iso", "1e30"}).err, far.err);
  const Outcome box = run({"extract", "head.nrrd", "--iso", "1324", "--box", "0,0,0,9,9,9"});
  EXPECT_NE(box.err.find("in --box"), std::string::npos) << box.err;
  fs::resize_file(path("head.nrrd"), 100000);
  expectFailure(1, {"extract", "head.nrrd", "--iso", "500", "-o", "c.ply"}, "head.nrrd");
}

}  // namespace
}  // namespace isobrick::test
