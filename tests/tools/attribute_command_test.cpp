// `isobrick extract` with numbers and colours of vertices, and its --check.
#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class AttributeCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "48", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
  static Words extract(const Words& more) {
    Words words = {"extract", "head.isb", "--iso", "1290"};
    if (std::ranges::count(more, "-o") > 0) words.push_back("--force");
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
};

TEST_F(AttributeCommandTest, SeveralAreReportedByTheirNames) {
  const Json json =
      runForJson(extract({"--attribute", "ct=head.isb", "--attribute", "nearest:head.isb",
                          "--attribute", "thickness:9", "--attribute", "gap=distance:500",
                          "--attribute", "component", "-o", "a.ply"}));
  Words names;
  for (const Json& one : json["attributes"]) names.push_back(one["name"]);
  EXPECT_EQ(names, (Words{"ct", "label", "thickness", "gap", "component"}));
  EXPECT_EQ(json["attributes"][1]["path"], "head.isb");
  EXPECT_EQ(json["attributes"][1]["vertices_outside"], 0);
  const std::string header = readBytes(path("a.ply")).substr(0, 1024);
  for (const char* line :
       {"property float ct\n", "property uint label\n", "property float thickness\n",
        "property float gap\n", "property uint component\n"})
    EXPECT_NE(header.find(line), std::string::npos) << line << header;
}

TEST_F(AttributeCommandTest, FilesAreTheSameForAnyThreadsAndMemory) {
  for (const char* ending : {".ply", ".vtp", ".glb", ".obj"}) {
    std::string first;
    for (const Words& more : {Words{"--threads", "1"}, Words{"--threads", "3"},
                              Words{"--threads", "2", "--memory", "1M"}}) {
      Words words = {"--attribute",  "thickness:9", "--attribute",
                     "distance:500", "-o",          std::string("a") + ending};
      if (ending != std::string(".vtp"))
        words.insert(words.end(), {"--color-by", "distance", "--colormap", "cool_warm:0:9"});
      words.insert(words.end(), more.begin(), more.end());
      runWell(extract(words));
      const std::string bytes = readBytes(path(std::string("a") + ending));
      if (first.empty()) first = bytes;
      EXPECT_TRUE(bytes == first) << ending << " " << more.back();
    }
  }
}

// A volume whose pyramid nobody needs gives the same.
TEST_F(AttributeCommandTest, ThicknessTakesThePyramidOfAVolume) {
  for (const char* volume : {"head.isb", "head.nrrd"})
    runWell({"extract", volume, "--iso", "1290", "--attribute", "thickness", "--attribute",
             "near=nearest:head.isb", "-o", std::string(volume) + ".ply"});
  EXPECT_EQ(readBytes(path("head.isb.ply")), readBytes(path("head.nrrd.ply")));
}

TEST_F(AttributeCommandTest, WrongUseIsRefused) {
  expectFailure(2, extract({"--attribute", "thickness:0", "-o", "a.ply"}), "--attribute");
  expectFailure(2, extract({"--attribute", "head.isb"}), "--output");
  expectFailure(2, extract({"--color-by", "value", "-o", "a.ply"}), "there is no attribute");
  expectFailure(2,
                extract({"--attribute", "distance:500", "--color-by", "distance", "-o", "a.ply"}),
                "--colormap viridis:MIN:MAX");
  expectFailure(2,
                extract({"--attribute", "thickness:5", "--color-by", "thickness", "--colormap",
                         "jet", "-o", "a.ply"}),
                "viridis, cividis");
  expectFailure(1,
                extract({"--attribute", "thickness:5", "--color-by", "thickness", "-o", "a.vtp"}),
                "no colours");
  expectFailure(1, extract({"--attribute", "distance:none.ply", "-o", "a.ply"}), "none.ply");
  expectFailure(
      1,
      extract({"--attribute", "head.isb", "--attribute", "value=nearest:head.isb", "-o", "a.ply"}),
      "take another name");
  EXPECT_FALSE(fs::exists(path("a.ply")));
}

TEST_F(AttributeCommandTest, TheCheckOfSharesIsThatOfTheWhole) {
  const Json whole = runForJson(extract({"--check"}))["check"];
  EXPECT_GT(whole["open_edges"], 0);  // the neck
  EXPECT_EQ(whole["nonmanifold_edges"], 0);
  EXPECT_EQ(whole["misoriented_edges"], 0);
  EXPECT_EQ(whole["crossing_triangles"], 0);
  EXPECT_FALSE(whole["solid"]);
  EXPECT_TRUE(whole["volume"].is_null());
  for (const char* part : {"1/2", "2/2"})
    runWell(extract({"--part", part, "-o", std::string(1, *part) + ".isbm"}));
  EXPECT_EQ(runForJson({"merge", "1.isbm", "2.isbm", "--check"})["check"], whole);
  EXPECT_EQ(runForJson(extract({"--check", "--threads", "1", "-o", "a.stl"}))["check"], whole);
  const std::string text = runWell(extract({"--check", "--simplify", "0.3"}));
  EXPECT_NE(text.find("check: open, "), std::string::npos) << text;
  EXPECT_NE(text.find("least angle"), std::string::npos) << text;
  expectFailure(2, extract({"--check", "--part", "1/2"}), "--part");
}

}  // namespace
}  // namespace isobrick::test
