// `isobrick convert` as users run it.
#include <algorithm>
#include <chrono>
#include <thread>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class ConvertCommandTest : public CommandTest {
 protected:
  // head.nrrd of 40^3 voxels and its pyramid.
  void makeHead() {
    runWell({"phantom", "head", "--size", "40", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
};

TEST_F(ConvertCommandTest, APyramidGivesBackTheVoxelsThatItWasBuiltOf) {
  makeHead();
  for (const std::string name :
       {"a.nrrd", "a.mhd", "a.mha", "a.nii", "a.nii.gz", "a.vti", "a.isb"}) {
    const Json json = runForJson({"convert", "head.isb", "-o", name, "--threads", "2"});
    EXPECT_EQ(json["dimensions"], Json({40, 40, 40})) << name;
    EXPECT_EQ(json["lost"], Json::array()) << name;
    EXPECT_EQ(json["space"], name.starts_with("a.nii") ? "RAS" : "LPS");
    // From there to the same voxels again, in one file without a header.
    const Outcome outcome = run({"convert", name, "-o", "again.raw", "--force"});
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    run({"convert", "head.nrrd", "-o", "first.raw", "--force"});
    EXPECT_EQ(readBytes(path("again.raw")), readBytes(path("first.raw"))) << name;
  }
}

TEST_F(ConvertCommandTest, LevelsBoxesAndWindowsAreWhatTheySay) {
  makeHead();
  Json json = runForJson({"convert", "head.isb", "-o", "a.nrrd", "--level", "1"});
  EXPECT_EQ(json["dimensions"], Json({21, 21, 21}));
  EXPECT_EQ(json["spacing"], Json({2.0, 2.0, 2.0}));
  // 39 voxels between the first and the last: the last sample repeats the border.
  ASSERT_EQ(json["notes"].size(), 3u);
  EXPECT_NE(json["notes"][0].get<std::string>().find("repeats the border voxel"),
            std::string::npos);
  json = runForJson(
      {"convert", "head.isb", "-o", "b.nrrd", "--level", "1", "--box", "3,4,5,20,21,22"});
  EXPECT_EQ(json["dimensions"], Json({9, 9, 9}));
  EXPECT_EQ(json["origin"], Json({4.0, 4.0, 6.0}));
  json = runForJson({"convert", "head.nrrd", "-o", "c.nrrd", "--box", "3,4,5,20,21,22", "--window",
                     "0,2550", "--type", "u8"});
  EXPECT_EQ(json["dimensions"], Json({18, 18, 18}));
  EXPECT_EQ(json["voxel_type"], "uint8");
  EXPECT_NE(json["notes"].dump().find("steps of 10:"), std::string::npos);
}

TEST_F(ConvertCommandTest, WrongWordsAreRefusedBeforeAnythingIsWritten) {
  makeHead();
  const auto usage = [&](Words words, const std::string& message) {
    words.insert(words.begin(), "convert");
    expectFailure(2, words, message);
  };
  usage({"head.nrrd", "-o", "a.nii", "--level", "1"}, "only pyramids");
  usage({"head.isb", "-o", "a.nii", "--type", "u8"}, "--window");
  usage({"head.isb", "-o", "a.nii", "--window", "0,9"}, "--type");
  usage({"head.isb", "-o", "a.nii", "--window", "9,0", "--type", "u8"}, "lower value");
  usage({"head.isb", "-o", "a.isb", "--levels", "all"}, "its own levels");
  usage({"head.isb", "-o", "a.nrrd", "--with-ranges"}, ".vdb");
  usage({"head.nrrd", "-o", "a.vdb", "--with-curvature"}, "pyramid");
  usage({"head.isb", "-o", "a.vdb", "--with-ranges", "--window", "0,9", "--type", "u8"},
        "--window");
  run({"convert", "head.isb", "-o", "scan.raw"});
  usage({"scan.raw", "-o", "a.nii"}, "--raw-dims");
  const auto failure = [&](Words words, const std::string& message) {
    words.insert(words.begin(), "convert");
    expectFailure(1, words, message);
  };
  failure({"head.isb", "-o", "a.foo"}, "'a.foo'");
  failure({"head.isb", "-o", "a.nii", "--levels", "all"}, "--level");
  failure({"head.isb", "-o", "a.nii", "--level", "9"}, "0 to 6");
  failure({"head.isb", "-o", "head.nrrd"}, "--force");
  failure({"head.isb", "-o", "head.isb", "--force"}, "is the input");
  failure({"head.nrrd", "-o", "./head.nrrd", "--force"}, "is the input");
  run({"convert", "head.isb", "-o", "voxels.raw"});
  failure({"head.isb", "-o", "voxels.mhd"}, "'voxels.raw' exists");
  failure({"head.isb", "-o", "voxels.raw/%d.tif"}, "'voxels.raw' exists");
  fs::create_directories(path("scans"));
  fs::copy_file(path("head.nrrd"), path("scans/head.nrrd"));
  failure({"head.isb", "-o", "scans/%d.tif", "--force"}, "something else");
  failure({"scans/head.nrrd", "-o", "scans/%d.tif", "--force"}, "holds the input");
  failure({"head.isb", "-o", "a.nii", "--memory", "1M"}, "--memory");
  failure({"head.isb", "-o", "a.nii", "--box", "30,30,30,50,50,50"}, "0,0,0 to 39,39,39");
  failure({"missing.isb", "-o", "a.nii"}, "missing.isb");
}

TEST_F(ConvertCommandTest, CtrlCLeavesNothingUnderTheFinalName) {
  runWell({"phantom", "gyroid", "--size", "300", "-o", "in.nrrd"});
  runWell({"build", "in.nrrd", "--no-curvature"});
  const std::set<std::string> before = files();
  for (const std::string name : {"a.nrrd", "a.nii.gz", "a.mhd", "a.isb"})
    for (const int milliseconds : {20, 60, 150}) {
      const pid_t pid = start({isobrickCommand(), "convert", "in.isb", "-o", name});
      std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
      kill(pid, SIGINT);
      const Outcome outcome = wait(pid);
      if (outcome.status == 0) {  // it was faster
        for (const std::string& file : files())
          if (!before.contains(file)) fs::remove(path(file));
        continue;
      }
      // Before the handler is there the signal ends the process, which has written nothing then.
      if (outcome.status != -SIGINT) {
        EXPECT_EQ(outcome.status, 130) << outcome.err;
      }
      EXPECT_EQ(files(), before) << name;
    }
}

}  // namespace
}  // namespace isobrick::test
