// No command replaces a file without --force, and with it the named output alone.
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <map>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class OutputRuleTest : public CommandTest {
 protected:
  // head.nrrd of 24^3 voxels and its pyramid.
  void makePyramid() {
    runWell({"phantom", "head", "--size", "24", "-o", "head.nrrd"});
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
       {Words{"phantom", "sphere", "--size", "8", "-o", "x.nrrd"},
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
  runWell({"phantom", "sphere", "--size", "8", "-o", "scan.mhd"});
  expectFailure(1, {"build", "scan.mhd", "-o", "scan.raw", "--force"}, "is the input");
  expectFailure(1, {"convert", "scan.mhd", "-o", "scan.raw", "--force"}, "is the input");
}

TEST_F(OutputRuleTest, AMetaImageReplacesOnlyTheVoxelsThatAreItsOwn) {
  writeBytes(path("scan.raw"), "somebody's scan");
  for (const Words& force : {Words{}, Words{"--force"}}) {
    Words words{"phantom", "sphere", "--size", "8", "-o", "scan.mhd"};
    words.insert(words.end(), force.begin(), force.end());
    expectFailure(1, words, "'scan.raw' exists and is not the data of 'scan.mhd'");
    EXPECT_EQ(readBytes(path("scan.raw")), "somebody's scan");
  }
  fs::remove(path("scan.raw"));
  runWell({"phantom", "sphere", "--size", "8", "-o", "scan.mhd"});
  expectFailure(1, {"phantom", "torus", "--size", "8", "-o", "scan.mhd"}, "--force");
  const std::string sphere = readBytes(path("scan.raw"));
  runWell({"phantom", "torus", "--size", "8", "-o", "scan.mhd", "--force"});
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

TEST_F(OutputRuleTest, AnHdf5FileKeepsAllButTheNamedDataset) {
  makePyramid();
  runWell({"phantom", "torus", "--size", "20", "-o", "torus.nrrd"});
  const auto convertTo = [&](const std::string& input, const std::string& name, bool force) {
    Words words{"convert", input, "-o", name};
    if (force) words.push_back("--force");
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
  };
  convertTo("head.nrrd", "results.h5:/a", false);
  chmod(path("results.h5").c_str(), 0640);
  // Another dataset replaces nothing.
  convertTo("torus.nrrd", "results.h5:/group/b", false);
  const std::string head = rawOf("head.nrrd"), torus = rawOf("torus.nrrd");
  EXPECT_EQ(rawOf("results.h5:/a"), head);
  EXPECT_EQ(rawOf("results.h5:/group/b"), torus);
  const std::string before = readBytes(path("results.h5"));
  expectFailure(1, {"convert", "torus.nrrd", "-o", "results.h5:/a"}, "--force");
  expectFailure(1, {"convert", "torus.nrrd", "-o", "results.h5:/group", "--force"}, "is a group");
  expectFailure(1, {"convert", "torus.nrrd", "-o", "results.h5:/a/b", "--force"}, "is no group");
  expectFailure(1, {"convert", "torus.nrrd", "-o", "results.h5:/", "--force"}, "names no dataset");
  EXPECT_EQ(readBytes(path("results.h5")), before);
  convertTo("torus.nrrd", "results.h5:/a", true);
  EXPECT_EQ(rawOf("results.h5:/a"), torus);
  EXPECT_EQ(rawOf("results.h5:/group/b"), torus);
  EXPECT_EQ(fs::status(path("results.h5")).permissions(), static_cast<fs::perms>(0640));
  // A link goes on to be one.
  fs::create_symlink("results.h5", path("link.h5"));
  convertTo("head.nrrd", "link.h5:/c", false);
  EXPECT_TRUE(fs::is_symlink(path("link.h5")));
  EXPECT_EQ(rawOf("results.h5:/c"), head);
  // Neither somebody else's file nor one that is being written is touched.
  writeBytes(path("text.h5"), "no HDF5");
  expectFailure(1, {"convert", "head.nrrd", "-o", "text.h5", "--force"}, "HDF5 cannot add to it");
  const int busy = open(path("results.h5").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_EQ(flock(busy, LOCK_EX), 0);
  expectFailure(1, {"convert", "head.nrrd", "-o", "results.h5:/d"}, "open for writing");
  close(busy);
}

// A kill at any moment leaves the old file, or the new one.
TEST_F(OutputRuleTest, AKilledConvertLeavesTheHdf5FileWhole) {
  runWell({"phantom", "gyroid", "--size", "160", "-o", "in.nrrd"});
  EXPECT_EQ(run({"convert", "in.nrrd", "-o", "results.h5:/a"}).status, 0);
  const std::string old = readBytes(path("results.h5"));
  const auto voxels = rawOf("in.nrrd");
  for (const int milliseconds : {5, 20, 60, 120, 250}) {
    for (const int signal : {SIGKILL, SIGINT}) {
      const pid_t pid = start({isobrickCommand(), "convert", "in.nrrd", "-o", "results.h5:/b"});
      usleep(static_cast<useconds_t>(1000 * milliseconds));
      kill(pid, signal);
      if (wait(pid).status == 0) {
        writeBytes(path("results.h5"), old);
        continue;
      }
      if (readBytes(path("results.h5")) == old) continue;
      // It had its name already, and the process had not ended.
      EXPECT_EQ(rawOf("results.h5:/a"), voxels) << milliseconds;
      EXPECT_EQ(rawOf("results.h5:/b"), voxels) << milliseconds;
      writeBytes(path("results.h5"), old);
    }
  }
  EXPECT_EQ(run({"convert", "in.nrrd", "-o", "results.h5:/b"}).status, 0);
  EXPECT_EQ(rawOf("results.h5:/b"), voxels);
}

// Unlike `build`, convert does not go on with what an earlier run began.
TEST_F(OutputRuleTest, AConvertThatFailsLeavesNothingAndPromisesNothing) {
  runWell({"phantom", "gyroid", "--size", "128", "-o", "in.nrrd"});
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
  runWell({"phantom", "torus", "--size", "20", "-o", "torus.nrrd"});
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
  const Words view{"view",     "head.isb", "--offscreen", "--script",   "script.json",
                   "--frames", "frames",   "--report",    "report.json"};
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
