// `isobrick extract --part` and `isobrick merge`.
#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class MergeCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "64", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd", "--brick", "16"});
  }
  // The shares of a query, with the words that say which.
  Words shares(const Words& query, int of) {
    Words names;
    for (int number = of; number >= 1; --number) {
      names.push_back("share" + std::to_string(number) + ".isbm");
      Words words = query;
      const std::string part = std::to_string(number) + "/" + std::to_string(of);
      for (const std::string& word : {std::string("--part"), part, std::string("-o"), names.back()})
        words.push_back(word);
      runWell(words);
    }
    return names;
  }
};

TEST_F(MergeCommandTest, SharesBecomeTheMeshOfOneRun) {
  for (const Words& choice :
       {Words{}, Words{"--focus", "32,32,32", "--radius", "12", "--simplify", "0.3"}}) {
    Words query = {"extract", "head.isb", "--iso", "900"};
    query.insert(query.end(), choice.begin(), choice.end());
    Words whole = query;
    for (const char* word : {"-o", "whole.ply", "--force"}) whole.emplace_back(word);
    runWell(whole);
    Words merge = shares(query, 3);
    merge.insert(merge.begin(), "merge");
    const Json counted = runForJson(merge);
    for (const char* word : {"-o", "merged.ply"}) merge.emplace_back(word);
    const Json written = runForJson(merge);
    EXPECT_TRUE(readBytes(path("merged.ply")) == readBytes(path("whole.ply")));
    EXPECT_EQ(counted["triangles"], written["triangles"]);
    EXPECT_EQ(counted["vertices"], written["vertices"]);
    EXPECT_EQ(written["shares"], 3);
    EXPECT_GT(written["triangles"], 1000);

    // A file that exists stays, and a share is no place for the mesh.
    expectFailure(1, merge, "'merged.ply' exists already; replace it with --force");
    merge.emplace_back("--force");
    runWell(merge);
    for (const char* file : {"merged.ply", "share1.isbm", "share2.isbm", "share3.isbm"})
      fs::remove(path(file));
  }
}

TEST_F(MergeCommandTest, AttributesAreThoseOfOneRun) {
  const Words query = {"extract", "head.isb", "--iso", "900"};
  runWell({"extract", "head.isb", "--iso", "1290", "-o", "bone.stl"});
  Words merge = shares(query, 2), whole = query;
  merge.insert(merge.begin(), "merge");
  for (const char* word :
       {"--attribute", "ct=head.nrrd", "--attribute", "nearest:head.isb", "--attribute",
        "distance:bone.stl", "--color-by", "distance", "--colormap", "inferno:0:9"}) {
    merge.emplace_back(word);
    whole.emplace_back(word);
  }
  for (const std::string ending : {".ply", ".glb", ".obj"}) {
    Words merged = merge, extracted = whole;
    merged.insert(merged.end(), {"-o", "merged" + ending});
    extracted.insert(extracted.end(), {"-o", "whole" + ending});
    runWell(merged);
    runWell(extracted);
    EXPECT_TRUE(readBytes(path("merged" + ending)) == readBytes(path("whole" + ending))) << ending;
  }
  merge.insert(merge.end(), {"--attribute", "thickness", "-o", "x.ply"});
  expectFailure(2, merge, "--attribute thickness needs the volume");
}

TEST_F(MergeCommandTest, VerticesWithoutAValueAreCounted) {
  runWell({"build", "phantom:sphere:16", "--origin", "900,900,900", "-o", "far.isb"});
  Words merge = shares({"extract", "head.isb", "--iso", "900"}, 2);
  merge.insert(merge.begin(), "merge");
  merge.insert(merge.end(), {"--attribute", "far.isb", "-o", "merged.ply"});
  const Outcome outcome = run(merge);
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_NE(outcome.err.find("lie outside of 'far.isb'"), std::string::npos) << outcome.err;
}

TEST_F(MergeCommandTest, APartOfAnotherFormatIsOpen) {
  const Json part =
      runForJson({"extract", "head.isb", "--iso", "900", "--part", "1/2", "-o", "part.ply"});
  EXPECT_EQ(part["part"], Json({{"number", 1}, {"of", 2}}));
  const Json whole = runForJson({"extract", "head.isb", "--iso", "900"});
  EXPECT_LT(part["triangles"], whole["triangles"]);
  EXPECT_GT(part["triangles"], 0);
}

TEST_F(MergeCommandTest, WrongUseIsRefused) {
  const Words query = {"extract", "head.isb", "--iso", "900", "--part", "1/2"};
  const auto with = [&](const Words& more) {
    Words words = query;
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  expectFailure(2, with({"--components"}), "--components");
  expectFailure(2, with({"--keep-largest", "1"}), "--keep-largest");
  expectFailure(2, with({"--triangles", "100"}), "--triangles");
  expectFailure(2, with({"-o", "x.precomputed"}), "--part does not go with a .precomputed");
  expectFailure(2, with({"-o", "x.isbm", "--zlib"}), "--zlib does not go with a share");
  for (const char* part : {"0/2", "3/2", "2", "a/b", "1/0", "1/2/3", "/", "1/9999999"})
    expectFailure(2, {"extract", "head.isb", "--iso", "900", "--part", part}, "--part");
  const Words names = shares({"extract", "head.isb", "--iso", "900"}, 2);
  expectFailure(1, {"merge", names[0], "-o", "x.ply"}, "without 1/2;");
  expectFailure(1, {"merge", names[0], names[1], "-o", "x.txt"}, "x.txt");
  expectFailure(1, {"merge", names[0], names[1], "-o", names[0], "--force"}, names[0]);
  expectFailure(2, {"merge"}, "SHARE");
}

}  // namespace
}  // namespace isobrick::test
