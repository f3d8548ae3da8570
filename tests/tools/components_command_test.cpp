// `isobrick extract` of some of a surface's connected pieces.
#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class ComponentsCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "64", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
  Json extracted(const Words& more) {
    Words words = {"extract", "head.isb", "--iso", "900"};
    words.insert(words.end(), more.begin(), more.end());
    return runForJson(words);
  }
};

TEST_F(ComponentsCommandTest, AreListedAndThoseThatAreWantedWritten) {
  const Json whole = extracted({"--components"});
  const Json& list = whole["components"];
  ASSERT_GE(list.size(), 3u);
  std::uint64_t triangles = 0;
  for (const Json& one : list) triangles += one["triangles"].get<std::uint64_t>();
  EXPECT_EQ(whole["triangles"], triangles);
  EXPECT_EQ(whole["components_kept"], list.size());
  EXPECT_TRUE(list[0]["volume"].is_null());  // the neck reaches the border
  EXPECT_TRUE(list[1]["volume"].is_number());

  const Json largest = extracted({"--keep-largest", "1", "-o", "largest.ply"});
  EXPECT_EQ(largest["components"], list);
  EXPECT_EQ(largest["components_kept"], 1u);
  EXPECT_EQ(largest["triangles"], list[0]["triangles"]);
  const double area = list[1]["area"];
  const Json dropped = extracted({"--drop-below", std::to_string(area * 0.999)});
  EXPECT_EQ(dropped["components_kept"], 2u);
  EXPECT_EQ(extracted({"--drop-below", "1e9"})["triangles"], 0u);

  const std::string text = runWell({"extract", "head.isb", "--iso", "900", "--keep-largest", "2"});
  EXPECT_NE(text.find("2 of them kept"), std::string::npos) << text;
}

TEST_F(ComponentsCommandTest, WrongUseIsRefused) {
  expectFailure(2, {"extract", "head.isb", "--iso", "900", "--keep-largest", "0"},
                "--keep-largest");
  expectFailure(2, {"extract", "head.isb", "--iso", "900", "--drop-below", "-1"}, "--drop-below");
  expectFailure(2, {"extract", "head.isb", "--iso", "900", "--drop-small"}, "--simplify");
}

}  // namespace
}  // namespace isobrick::test
