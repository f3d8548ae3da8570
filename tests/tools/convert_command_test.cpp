// `isobrick convert` as users run it.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/command_test.h"
#include "tests/support/nifti_file.h"
#include "tests/support/tiff_file.h"

namespace isobrick::test {
namespace {

class ConvertCommandTest : public CommandTest {
 protected:
  // head.nrrd of 40^3 voxels and its pyramid.
  void makeHead() {
    runWell({"phantom", "head", "--voxels", "40", "-o", "head.nrrd"});
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

template <typename T>
std::string nrrdOf(const std::string& type, const std::vector<T>& values) {
  const std::string edge = std::to_string(std::lround(std::cbrt(values.size())));
  return "NRRD0004\ntype: " + type + "\ndimension: 3\nsizes: " + edge + " " + edge + " " + edge +
         "\nendian: little\nencoding: raw\n\n" +
         std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

// The numbers at the end of a file.
template <typename T>
std::vector<T> lastNumbers(const std::string& bytes, std::size_t count) {
  std::vector<T> values(count);
  std::memcpy(values.data(), bytes.data() + (bytes.size() - count * sizeof(T)), count * sizeof(T));
  return values;
}

TEST_F(ConvertCommandTest, NumbersThatNoPyramidHoldsComeOutAsTheyWere) {
  std::vector<double> reals(1000);
  std::vector<std::int32_t> times(1000), scan(1000);
  for (std::size_t i = 0; i < reals.size(); ++i) {
    reals[i] = 101325 + 1e-5 * static_cast<double>(i * i % 997);
    times[i] = 1700000000 + static_cast<std::int32_t>(i * i % 997);
    scan[i] = -1024 + static_cast<std::int32_t>(i * i % 997);
  }
  writeBytes(path("p.nrrd"), nrrdOf("double", reals));
  writeBytes(path("t.nrrd"), nrrdOf("int", times));
  writeBytes(path("s.nrrd"), nrrdOf("int", scan));
  EXPECT_EQ(runForJson({"build", "p.nrrd"})["voxel_type"], "float32");
  EXPECT_EQ(runForJson({"build", "t.nrrd"})["voxel_type"], "uint16");
  EXPECT_EQ(runForJson({"build", "s.nrrd"})["voxel_type"], "int16");
  EXPECT_EQ(runForJson({"convert", "p.isb", "-o", "q.nrrd"})["voxel_type"], "float64");
  EXPECT_EQ(runForJson({"convert", "t.isb", "-o", "u.nrrd"})["voxel_type"], "int32");
  EXPECT_EQ(runForJson({"convert", "s.isb", "-o", "v.nrrd"})["voxel_type"], "int16");
  const auto back = lastNumbers<double>(readBytes(path("q.nrrd")), reals.size());
  for (std::size_t i = 0; i < reals.size(); ++i) ASSERT_NEAR(back[i], reals[i], 1e-9);
  EXPECT_EQ(lastNumbers<std::int32_t>(readBytes(path("u.nrrd")), times.size()), times);
  const Json info = runForJson({"info", "t.isb"});
  EXPECT_EQ(info["value_range"], Json({1700000000.0, 1700000996.0}));
  EXPECT_EQ(info["stored_values"]["offset"], 1700000000.0);

  // Without a pyramid between, in every format that has the type.
  for (const std::string name :
       {"a.nrrd", "a.mha", "a.nii", "a.vti", "a.h5", "a.ome.zarr", "a.tif"}) {
    EXPECT_EQ(run({"convert", "p.nrrd", "-o", name}).status, 0) << name;
    const Outcome again = run({"convert", name, "-o", "again.raw", "--force", "--json"});
    ASSERT_EQ(again.status, 0) << again.err;
    EXPECT_EQ(Json::parse(again.out)["voxel_type"], "float64") << name;
    EXPECT_EQ(lastNumbers<double>(readBytes(path("again.raw")), reals.size()), reals) << name;
  }
  for (const std::string input : {"p.isb", "p.nrrd"}) {
    const std::string output = input + ".vdb";
    expectFailure(1, {"convert", input, "-o", output}, "allow the loss");
    const Outcome lossy = run({"convert", input, "-o", output, "--lossy", "--json"});
    ASSERT_EQ(lossy.status, 0) << lossy.err;
    EXPECT_NE(Json::parse(lossy.out)["lost"].dump().find("values changed as float32"),
              std::string::npos);
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
  usage({"head.nrrd", "-o", "a.nii", "--level", "1"}, "--level is for pyramids");
  usage({"head.isb", "-o", "a.nii", "--type", "u8"}, "--window");
  usage({"head.isb", "-o", "a.nii", "--window", "0,9"}, "--type");
  usage({"head.isb", "-o", "a.nii", "--window", "9,0", "--type", "u8"}, "lower value");
  usage({"head.isb", "-o", "a.isb", "--all-levels"}, "--all-levels is for .vdb and .ome.zarr");
  usage({"head.isb", "-o", "a.nrrd", "--with-ranges"}, "--with-ranges is for .vdb");
  usage({"head.nrrd", "-o", "a.vdb", "--with-curvature"}, "--with-curvature is for pyramids");
  usage({"head.isb", "-o", "a.vdb", "--with-ranges", "--spacing", "1,1,2"}, "leave out");
  run({"convert", "head.isb", "-o", "scan.raw"});
  usage({"scan.raw", "-o", "a.nii"}, "--raw-dims");
  const auto failure = [&](Words words, const std::string& message) {
    words.insert(words.begin(), "convert");
    expectFailure(1, words, message);
  };
  failure({"head.isb", "-o", "a.foo"}, "'a.foo'");
  usage({"head.isb", "-o", "a.nii", "--all-levels"}, "--all-levels is for .vdb and .ome.zarr");
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
  for (const std::string box :
       {"30,30,30,50,50,50", "0,0,0,9,9,1e300", "-1e300,0,0,9,9,9", "-1,0,0,9,9,9"})
    for (const std::string input : {"head.isb", "head.nrrd"})
      failure({input, "-o", "a.nii", "--box", box}, "0,0,0 to 39,39,39");
  failure({"missing.isb", "-o", "a.nii"}, "missing.isb");
}

// An option that would change nothing is a mistake that nobody would see.
TEST_F(ConvertCommandTest, OptionsOfAnotherFormatAreRefused) {
  makeHead();
  run({"convert", "head.isb", "-o", "head.nii"});
  run({"convert", "head.isb", "-o", "head.h5"});
  for (const Words& words : {Words{"--half"},
                             {"--vdb-background", "3"},
                             {"--vdb-tolerance", "3"},
                             {"--zarr-version", "2"},
                             {"--zarr-shard", "128"},
                             {"--vdb-codec", "zip"},
                             {"--part", "1/2"},
                             {"--codec", "zstd"},
                             {"--no-curvature"}}) {
    Words all{"convert", "head.isb", "-o", "a.nrrd"};
    all.insert(all.end(), words.begin(), words.end());
    expectFailure(2, all, words.front() + " is for ");
  }
  for (const std::string command : {"build", "convert"}) {
    expectFailure(2, {command, "head.nrrd", "-o", "a.isb", "--dicom-float32"},
                  "--dicom-float32 is for ");
    expectFailure(2, {command, "head.nii", "-o", "a.isb", "--select", "grid=density"},
                  "--select grid is for ");
    for (const std::string choice : {"time=1", "channel=1"})
      expectFailure(1, {command, "head.h5", "-o", "a.isb", "--select", choice}, "to choose");
    expectFailure(1, {command, "head.nii", "-o", "a.isb", "--select", "component=0"},
                  "cannot take");
    expectFailure(2, {command, "head.nii", "-o", "a.isb", "--select", "array=density"},
                  "--select array is for ");
    expectFailure(1, {command, "head.nrrd", "-o", "a.isb", "--select", "time=1"}, "no time steps");
    expectFailure(1, {command, "head.nii", "-o", "a.isb", "--select", "channel=1"}, "cannot take");
    expectFailure(2, {command, "head.nrrd", "-o", "a.isb", "--select", "time"}, "KEY=VALUE");
    expectFailure(2, {command, "head.nrrd", "-o", "a.isb", "--select", "time=a"}, "'a'");
    expectFailure(2, {command, "head.nrrd", "-o", "a.isb", "--select", "colour=1"}, "component");
  }
  expectFailure(2, {"convert", "head.nii", "-o", "a.isb", "--no-map"}, "--no-map is for pyramids");
  expectFailure(2, {"convert", "head.nii", "-o", "a.zarr", "--zarr-version", "4"},
                "--zarr-version");
  expectFailure(2, {"convert", "head.nii", "-o", "a.zarr", "--zarr-shard", "100"},
                "no multiple of 64");
  expectFailure(
      2, {"convert", "head.nii", "-o", "a.zarr", "--zarr-shard", "64", "--zarr-version", "2"},
      "Zarr 2 has no shards");
  expectFailure(2, {"convert", "head.nii", "-o", "a.zarr", "--part", "1/2", "--zarr-version", "2"},
                "Zarr 2 has no shards; leave out --part");
  expectFailure(2,
                {"convert", "head.isb", "-o", "a.nii", "--raw-dims", "9,9,9", "--raw-type", "u8"},
                "--raw-dims is for");
}

// 65,519 is 65504 as a half float, 65,520 would be infinite.
TEST_F(ConvertCommandTest, HalfFloatsTakeNoValueThatTheyCannotHold) {
  for (const float beyond : {65520.0f, -65520.0f, 1e9f}) {
    std::vector<float> values(10 * 10 * 10, 1.0f);
    values[500] = std::copysign(65519.0f, beyond);
    const auto convert = [&] {
      writeBytes(path("v.raw"), {reinterpret_cast<const char*>(values.data()),
                                 values.size() * sizeof values.front()});
      return run({"convert", "v.raw", "--raw-dims", "10,10,10", "--raw-type", "f32", "-o", "v.vdb",
                  "--half", "--force"});
    };
    EXPECT_EQ(convert().status, 0);
    values[501] = beyond;
    checkFailure(convert(), 1, "beyond half floats, which end at 65504; leave out --half");
    std::fill(values.begin(), values.end(), beyond);  // a tile, and no leaf
    checkFailure(convert(), 1, "beyond half floats");
  }
  runWell({"phantom", "sphere", "--voxels", "8", "-o", "s.nrrd"});
  expectFailure(1, {"convert", "s.nrrd", "-o", "s.vdb", "--half", "--vdb-background", "7e4"},
                "the value 70000 is beyond half floats");
}

// Three time steps of 6 x 5 x 4 voxels, in which voxel i of step t is 1000 t + i.
TEST_F(ConvertCommandTest, ATimeStepOfNiftiIsTaken) {
  for (const bool big_endian : {false, true}) {
    std::string bytes = niftiHeader({6, 5, 4}, {}, big_endian);
    bytes[40 + (big_endian ? 1 : 0)] = 4;  // dim[0] and dim[4]
    bytes[48 + (big_endian ? 1 : 0)] = 3;
    for (int i = 0; i < 360; ++i) {
      const int value = 1000 * (i / 120) + i % 120;
      const char low = static_cast<char>(value & 255), high = static_cast<char>(value >> 8);
      bytes += big_endian ? std::string{high, low} : std::string{low, high};
    }
    writeBytes(path("steps.nii"), bytes);
    const auto firstOf = [&](Words words, int step) {
      words.insert(words.begin(), {"convert", "steps.nii", "-o", "step.raw", "--force", "--json"});
      const Outcome outcome = run(words);
      EXPECT_EQ(outcome.status, 0) << outcome.err;
      EXPECT_NE(outcome.out.find("time step " + std::to_string(step) + " of 3"), std::string::npos)
          << outcome.out;
      std::int16_t first = -1;
      std::memcpy(&first, readBytes(path("step.raw")).data(), sizeof first);
      return first;
    };
    EXPECT_EQ(firstOf({}, 0), 0);
    EXPECT_EQ(firstOf({"--select", "time=0"}, 0), 0);
    EXPECT_EQ(firstOf({"--select", "time=2"}, 2), 2000);
    expectFailure(1, {"convert", "steps.nii", "-o", "x.raw", "--select", "time=3"},
                  "0 to 2, and none is number 3");
    // Another step is another volume.
    EXPECT_EQ(runForJson({"build", "steps.nii", "--select", "time=1", "-o", "s.isb"})["skipped"],
              false);
    EXPECT_EQ(runForJson({"build", "steps.nii", "--select", "time=1", "-o", "s.isb"})["skipped"],
              true);
    EXPECT_EQ(runForJson({"build", "steps.nii", "--select", "time=2", "-o", "s.isb"})["skipped"],
              false);
  }
}

// A folder has no choice of a component: the line that refuses it must not advise that.
TEST_F(ConvertCommandTest, SlicesOfColoursAreRefusedWithoutACircle) {
  fs::create_directories(path("slices"));
  for (const char* name : {"slices/1.tif", "slices/2.tif"})
    writeBytes(path(name), tiffBytes(4, 3, 8, std::string(4 * 3 * 3, 'c'), 3));
  expectFailure(1, {"convert", "slices", "-o", "a.nrrd"}, "convert them to grey ones");
  EXPECT_EQ(run({"convert", "slices", "-o", "a.nrrd"}).err.find("component"), std::string::npos);
  expectFailure(1, {"convert", "slices", "-o", "a.nrrd", "--select", "component=0"},
                "only single files");
}

TEST_F(ConvertCommandTest, CtrlCLeavesNothingUnderTheFinalName) {
  runWell({"phantom", "gyroid", "--voxels", "300", "-o", "in.nrrd"});
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
