// No command replaces a file without --force, and with it the named output alone.
#include <map>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class OutputRuleTest : public CommandTest {
 protected:
  // head.nrrd of 24^3 voxels and its pyramid.
  void makePyramid() {
    runWell({"phantom", "head", "--voxels", "24", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
  void expectRefused(const Words& words, const std::string& file) {
    const std::string before = readBytes(path(file));
    expectFailure(1, words, "'" + file + "' exists already; replace it with --force");
    EXPECT_EQ(readBytes(path(file)), before) << file;
  }
  std::string rawOf(const std::string& volume) {
    const Outcome outcome = run({"convert", volume, "-o", "voxels.raw", "--force"});
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return readBytes(path("voxels.raw"));
  }
};

TEST_F(OutputRuleTest, EveryCommandRefusesWhatExistsAndReplacesItWithForce) {
  makePyramid();
  for (const Words& words :
       {Words{"phantom", "sphere", "--voxels", "8", "-o", "x.nrrd"},
        Words{"extract", "head.isb", "--iso", "500", "-o", "x.ply"},
        Words{"extract", "head.isb", "--iso", "500", "-o", "x.obj"},
        Words{"render", "head.isb", "--iso", "500", "--size", "64x64", "-o", "x.png"},
        Words{"convert", "head.isb", "-o", "x.nii"}, Words{"convert", "head.isb", "-o", "x.isb"},
        Words{"build", "head.nrrd", "-o", "y.isb"}}) {
    const std::string& file = words.back();
    writeBytes(path(file), "precious");
    expectRefused(words, file);
    Words forced = words;
    forced.push_back("--force");
    EXPECT_EQ(run(forced).status, 0) << file;
    EXPECT_GT(readBytes(path(file)).size(), 100u) << file;
  }
  // A link that leads nowhere is there, too.
  fs::create_symlink(path("nowhere"), path("link.ply"));
  expectFailure(1, {"extract", "head.isb", "--iso", "500", "-o", "link.ply"}, "exists already");
}

TEST_F(OutputRuleTest, AnInputIsNeverReplaced) {
  makePyramid();
  runWell({"build", "head.nrrd", "-o", "other.isb"});
  for (const Words& words :
       {Words{"extract", "head.isb", "--iso", "500", "-o", "head.isb"},
        Words{"extract", "head.isb", "--iso", "500", "--attribute", "other.isb", "-o", "other.isb"},
        Words{"convert", "head.nrrd", "-o", "head.nrrd"},
        Words{"build", "head.nrrd", "-o", "head.nrrd"}}) {
    Words forced = words;
    forced.push_back("--force");
    const std::string before = readBytes(path(words.back()));
    expectFailure(1, forced, "is the input");
    EXPECT_EQ(readBytes(path(words.back())), before);
  }
  // Nor one of its files: the voxels behind a header.
  runWell({"phantom", "sphere", "--voxels", "8", "-o", "scan.mhd"});
  expectFailure(1, {"build", "scan.mhd", "-o", "scan.raw", "--force"}, "is the input");
  expectFailure(1, {"convert", "scan.mhd", "-o", "scan.raw", "--force"}, "is the input");
}

TEST_F(OutputRuleTest, AMetaImageReplacesOnlyTheVoxelsThatAreItsOwn) {
  writeBytes(path("scan.raw"), "somebody's scan");
  for (const Words& force : {Words{}, Words{"--force"}}) {
    Words words{"phantom", "sphere", "--voxels", "8", "-o", "scan.mhd"};
    words.insert(words.end(), force.begin(), force.end());
    expectFailure(1, words, "'scan.raw' exists and is not the data of 'scan.mhd'");
    EXPECT_EQ(readBytes(path("scan.raw")), "somebody's scan");
  }
  fs::remove(path("scan.raw"));
  runWell({"phantom", "sphere", "--voxels", "8", "-o", "scan.mhd"});
  expectFailure(1, {"phantom", "torus", "--voxels", "8", "-o", "scan.mhd"}, "--force");
  const std::string sphere = readBytes(path("scan.raw"));
  runWell({"phantom", "torus", "--voxels", "8", "-o", "scan.mhd", "--force"});
  EXPECT_NE(readBytes(path("scan.raw")), sphere);
}

// Names of temporaries may be somebody else's files.
TEST_F(OutputRuleTest, FilesBesideTheOutputStay) {
  makePyramid();
  fs::create_directories(path("out.partial"));
  const std::map<std::string, std::string> precious{{"out.partial/notes", "a"},
                                                    {"x.nii.partial", "b"},
                                                    {"x.ply.partial", "c"},
                                                    {"x.png.partial", "d"},
                                                    {"x.tif.partial", "e"}};
  for (const auto& [name, bytes] : precious) writeBytes(path(name), bytes);
  EXPECT_EQ(run({"convert", "head.isb", "-o", "out/%04d.tif"}).status, 0);
  EXPECT_EQ(run({"convert", "head.isb", "-o", "x.nii"}).status, 0);
  EXPECT_EQ(run({"convert", "head.isb", "-o", "x.tif"}).status, 0);
  EXPECT_EQ(run({"extract", "head.isb", "--iso", "500", "-o", "x.ply"}).status, 0);
  EXPECT_EQ(run({"render", "head.isb", "--iso", "500", "--size", "64x64", "-o", "x.png"}).status,
            0);
  for (const auto& [name, bytes] : precious) EXPECT_EQ(readBytes(path(name)), bytes) << name;
  // That of a pyramid, which can be gone on with, is looked at: also a short one.
  for (const char* name : {"new.isb.partial", "new.isb.partial.journal"}) {
    writeBytes(path(name), "memo");
    expectFailure(1, {"build", "head.nrrd", "-o", "new.isb"}, "is not an unfinished pyramid");
    EXPECT_EQ(readBytes(path(name)), "memo");
    fs::remove(path(name));
  }
}

TEST_F(OutputRuleTest, AFolderIsReplacedOnlyWhereItHoldsSuchSlicesAlone) {
  makePyramid();
  run({"convert", "head.isb", "-o", "out/s%03d.tif"});
  expectFailure(1, {"convert", "head.isb", "-o", "out/s%03d.tif"}, "--force");
  EXPECT_EQ(run({"convert", "head.isb", "-o", "out/s%03d.tif", "--level", "1", "--force"}).status,
            0);
  EXPECT_FALSE(fs::exists(path("out/s023.tif")));
  writeBytes(path("out/mask.tif"), "a mask");
  expectFailure(1, {"convert", "head.isb", "-o", "out/s%03d.tif", "--force"}, "something else");
  EXPECT_EQ(readBytes(path("out/mask.tif")), "a mask");
}

// A file like any other, whatever dataset of it is named.
TEST_F(OutputRuleTest, AnHdf5FileIsReplacedWithForceAlone) {
  makePyramid();
  runWell({"phantom", "torus", "--voxels", "20", "-o", "torus.nrrd"});
  EXPECT_EQ(run({"convert", "head.nrrd", "-o", "results.h5:/group/a"}).status, 0);
  EXPECT_EQ(rawOf("results.h5:/group/a"), rawOf("head.nrrd"));
  const std::string before = readBytes(path("results.h5"));
  for (const char* const name : {"results.h5:/group/a", "results.h5:/b", "results.h5"})
    expectFailure(1, {"convert", "torus.nrrd", "-o", name},
                  "'results.h5' exists already; replace it with --force");
  expectFailure(1, {"convert", "torus.nrrd", "-o", "results.h5:/", "--force"}, "names no dataset");
  expectFailure(1, {"convert", "results.h5", "-o", "results.h5:/b", "--force"}, "is the input");
  EXPECT_EQ(readBytes(path("results.h5")), before);
  EXPECT_EQ(run({"convert", "torus.nrrd", "-o", "results.h5:/b", "--force"}).status, 0);
  EXPECT_EQ(rawOf("results.h5"), rawOf("torus.nrrd"));  // its only dataset
}

// Unlike `build`, convert does not go on with what an earlier run began.
TEST_F(OutputRuleTest, AConvertThatFailsLeavesNothingAndPromisesNothing) {
  runWell({"phantom", "gyroid", "--voxels", "128", "-o", "in.nrrd"});
  const std::set<std::string> before = files();
  const Outcome outcome = wait(start({"/bin/sh", "-c",
                                      "ulimit -f 600; exec $0 convert in.nrrd -o "
                                      "x.isb --codec none --no-curvature",
                                      isobrickCommand()}));
  checkFailure(outcome, 1, "x.isb");
  EXPECT_EQ(outcome.err.find("--resume"), std::string::npos) << outcome.err;
  EXPECT_EQ(files(), before);
}

TEST_F(OutputRuleTest, RebuildIsForWhatIsUpToDateAndForceForWhatIsNot) {
  makePyramid();
  runWell({"phantom", "torus", "--voxels", "20", "-o", "torus.nrrd"});
  EXPECT_EQ(runForJson({"build", "head.nrrd", "--force"})["skipped"], true);
  EXPECT_EQ(runForJson({"build", "head.nrrd", "--rebuild"})["skipped"], false);
  const std::string head = readBytes(path("head.isb"));
  expectFailure(1, {"build", "torus.nrrd", "-o", "head.isb", "--rebuild"}, "--force");
  EXPECT_EQ(readBytes(path("head.isb")), head);
  runWell({"build", "torus.nrrd", "-o", "head.isb", "--force"});
  EXPECT_NE(readBytes(path("head.isb")), head);
}

TEST_F(OutputRuleTest, AScriptedViewReplacesNothing) {
  makePyramid();
  writeBytes(path("script.json"),
             R"({"size": [160, 120], "steps": [{"wait": "settled"}, {"frame": "a.png"}]})");
  fs::create_directories(path("frames"));
  const Words view{"view",      "head.isb", "--offscreen", "--script",   "script.json",
                   "--out-dir", "frames",   "--report",    "report.json"};
  for (const std::string file : {"frames/a.png", "report.json"}) {
    writeBytes(path(file), "precious");
    expectRefused(view, file);
    fs::remove(path(file));
  }
  runWell(view);
  Words again = view;
  again.push_back("--force");
  runWell(again);
}

}  // namespace
}  // namespace isobrick::test
