// `isobrick extract` of several isovalues in one run.
#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class SeveralIsovaluesTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "48", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
};

TEST_F(SeveralIsovaluesTest, EachIsWhatItIsAlone) {
  const Json json =
      runForJson({"extract", "head.isb", "--iso", "500,1324.5", "--iso", "900", "-o", "m.ply"});
  ASSERT_EQ(json["surfaces"].size(), 3u);
  const std::pair<const char*, const char*> wanted[] = {
      {"500", "m-500.ply"}, {"1324.5", "m-1324.5.ply"}, {"900", "m-900.ply"}};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& [isovalue, name] = wanted[i];
    const Json alone =
        runForJson({"extract", "head.isb", "--iso", isovalue, "-o", "alone.ply", "--force"});
    EXPECT_EQ(readBytes(path(name)), readBytes(path("alone.ply"))) << name;
    const Json& surface = json["surfaces"][i];
    EXPECT_EQ(surface["output"], name);
    for (const char* key : {"isovalue", "triangles", "vertices", "levels", "bricks"})
      EXPECT_EQ(surface[key], alone[key]) << key;
    EXPECT_EQ(surface["seconds"]["extract"].size(), 1u);
  }
  EXPECT_TRUE(json["seconds"].contains("open"));
  EXPECT_FALSE(fs::exists(path("m.ply")));
}

TEST_F(SeveralIsovaluesTest, OneIsAnObjectOfItsOwn) {
  const Json json = runForJson({"extract", "head.isb", "--iso", "500", "-o", "m.ply"});
  EXPECT_EQ(json["output"], "m.ply");
  EXPECT_EQ(json["isovalue"], 500.0);
  for (const char* key : {"open", "extract", "write"}) EXPECT_TRUE(json["seconds"].contains(key));
  ASSERT_EQ(json["surfaces"].size(), 1u);
  EXPECT_EQ(json["surfaces"][0]["output"], "m.ply");
}

TEST_F(SeveralIsovaluesTest, NothingIsWrittenIfOneOfThemIsInTheWay) {
  runWell({"extract", "head.isb", "--iso", "900", "-o", "m-900.ply"});
  expectFailure(1, {"extract", "head.isb", "--iso", "500,900", "-o", "m.ply"}, "m-900.ply");
  expectFailure(2, {"extract", "head.isb", "--iso", "500,500"}, "given twice");
  expectFailure(2, {"extract", "head.isb", "--iso", "500,"}, "--iso");
  expectFailure(2, {"bench", "head.isb", "--iso", "500,900"}, "one isovalue");
}

}  // namespace
}  // namespace isobrick::test
