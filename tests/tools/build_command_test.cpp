// `isobrick build` from outside: which outputs are left, built again or never touched, lists of
// inputs, and what is printed. Interrupted builds are in build_resume_test.cpp.
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>

#include "tests/support/command_test.h"
#include "tests/support/random_numbers.h"
#include "tests/support/test_paths.h"

namespace isobrick {
namespace {

using namespace test;

class BuildCommandTest : public CommandTest {
 protected:
  void makeVolume(const std::string& name, const char* phantom = "sphere", int size = 32) {
    runWell({"phantom", phantom, "--voxels", std::to_string(size), "-o", name, "--force"});
  }
  // As if somebody had written the file again.
  void touch(const std::string& name) {
    fs::last_write_time(path(name), fs::last_write_time(path(name)) + std::chrono::seconds(5));
  }
  // A pyramid that was written again has another inode.
  ino_t inode(const std::string& name) const {
    struct stat status = {};
    EXPECT_EQ(stat(path(name).c_str(), &status), 0) << name;
    return status.st_ino;
  }
  bool isSkipped(const Words& words) { return runForJson(words)["skipped"].get<bool>(); }
  // The JSON of a run that ends with `status`, and the lines that it wrote to stderr.
  std::pair<Json, Outcome> runListForJson(Words words, int status) {
    words.push_back("--json");
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, status) << outcome.err;
    return {Json::parse(outcome.out), outcome};
  }
  static void expectContains(const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << "'" << part << "' is not in:\n" << text;
  }
};

// In noise no surface of level 1 is near one of level 0; a query with a tolerance is then without.
TEST_F(BuildCommandTest, AVolumeThatHasNothingToGainStoresNoCurvature) {
  std::string voxels(40 * 40 * 40, '\0');
  Random random(1);
  for (char& voxel : voxels) voxel = static_cast<char>(randomBelow(random, 256));
  writeBytes(path("noise.raw"), voxels);
  const std::string said = runWell(
      {"build", "noise.raw", "--raw-dims", "40,40,40", "--raw-type", "u8", "-o", "noise.isb"});
  expectContains(said, "no curvature is stored, since there is nothing to gain");
  EXPECT_EQ(runForJson({"info", "noise.isb"})["bytes"]["curvature"], 0);
  const Words query = {"extract", "noise.isb", "--iso",    "128",
                       "--focus", "20,20,20",  "--radius", "9"};
  const auto meshOf = [&](Words words, const std::string& name) {
    words.insert(words.end(), {"-o", name});
    runWell(words);
    return readBytes(path(name));
  };
  Words with_tolerance = query;
  with_tolerance.insert(with_tolerance.end(), {"--curvature-radius", "5"});
  EXPECT_EQ(meshOf(query, "a.ply"), meshOf(with_tolerance, "b.ply"));
  makeVolume("ball.nrrd");
  EXPECT_EQ(runWell({"build", "ball.nrrd"}).find("nothing to gain"), std::string::npos);
}

TEST_F(BuildCommandTest, WhatIsUpToDateIsSkipped) {
  makeVolume("a.nrrd");
  EXPECT_FALSE(isSkipped({"build", "a.nrrd"}));
  const ino_t before = inode("a.isb");
  const std::string bytes = readBytes(path("a.isb"));
  expectContains(runWell({"build", "a.nrrd"}), "a.isb: skipped: up to date");
  // Neither the spelling of the path, nor what does not change the result, makes a difference.
  EXPECT_TRUE(isSkipped({"build", "./a.nrrd", "--threads", "1"}));
  EXPECT_TRUE(isSkipped({"build", path("a.nrrd"), "--memory", "100M", "--resume"}));
  EXPECT_EQ(inode("a.isb"), before);
  EXPECT_FALSE(isSkipped({"build", "a.nrrd", "--rebuild"}));
  EXPECT_NE(inode("a.isb"), before);
  EXPECT_EQ(readBytes(path("a.isb")), bytes);
}

TEST_F(BuildCommandTest, AChangedInputIsBuiltAgain) {
  makeVolume("a.nrrd");
  runWell({"build", "a.nrrd"});
  const std::string old = readBytes(path("a.isb"));
  touch("a.nrrd");
  EXPECT_FALSE(isSkipped({"build", "a.nrrd"}));
  EXPECT_TRUE(isSkipped({"build", "a.nrrd"}));
  makeVolume("a.nrrd", "torus", 40);
  const Json built = runForJson({"build", "a.nrrd"});
  EXPECT_EQ(built["skipped"], false);
  EXPECT_EQ(built["dimensions"], Json({40, 40, 40}));
  EXPECT_NE(readBytes(path("a.isb")), old);
}

TEST_F(BuildCommandTest, TheDataBehindAHeaderCounts) {
  makeVolume("a.mhd");
  runWell({"build", "a.mhd"});
  EXPECT_TRUE(isSkipped({"build", "a.mhd"}));
  touch("a.raw");
  EXPECT_FALSE(isSkipped({"build", "a.mhd"}));
}

// The voxels are the same bytes and mean other numbers.
TEST_F(BuildCommandTest, TheHeaderBeforeTheDataCounts) {
  makeVolume("a.mhd", "head");
  runWell({"build", "a.mhd"});
  const std::string old = readBytes(path("a.isb"));
  std::string header = readBytes(path("a.mhd"));
  const std::size_t order = header.find("ByteOrderMSB = False");
  ASSERT_NE(order, std::string::npos) << header;
  header.replace(order, 20, "ByteOrderMSB = True");
  writeBytes(path("a.mhd"), header);
  EXPECT_FALSE(isSkipped({"build", "a.mhd"}));
  EXPECT_NE(readBytes(path("a.isb")), old);
  EXPECT_TRUE(isSkipped({"build", "a.mhd"}));
}

TEST_F(BuildCommandTest, OtherOptionsAreBuiltAgain) {
  makeVolume("a.nrrd");
  const std::vector<Words> variants = {{},
                                       {"--codec", "zstd"},
                                       {"--codec", "none"},
                                       {"--no-curvature"},
                                       {"--brick", "16"},
                                       {"--tile", "8"},
                                       {"--nan-as", "3"},
                                       {"--curvature-epsilon", "0.5"},
                                       {"--filter", "subsample"}};
  for (const Words& variant : variants) {
    Words words = {"build", "a.nrrd"};
    words.insert(words.end(), variant.begin(), variant.end());
    EXPECT_FALSE(isSkipped(words)) << variant.back();
    EXPECT_TRUE(isSkipped(words)) << variant.back();
  }
}

TEST_F(BuildCommandTest, PhantomsAreBuiltWithoutAFileInBetween) {
  makeVolume("a.nrrd", "gyroid", 40);
  runWell({"build", "a.nrrd"});
  EXPECT_FALSE(isSkipped({"build", "phantom:gyroid:40"}));
  EXPECT_TRUE(isSkipped({"build", "phantom:gyroid:40"}));
  const auto surface = [&](const char* pyramid) {
    return runForJson({"extract", pyramid, "--iso", "128"})["triangles"];
  };
  EXPECT_EQ(surface("gyroid-40.isb"), surface("a.isb"));
  expectFailure(1, {"build", "phantom:nobody"}, "nobody");
  expectFailure(1, {"build", "phantom:head:1"}, "phantom:head:1");
}

TEST_F(BuildCommandTest, ProgressComesAsLinesForPrograms) {
  makeVolume("a.nrrd", "sphere", 64);
  const Outcome outcome = run({"build", "a.nrrd", "--progress-lines", "--json"});
  EXPECT_EQ(outcome.status, 0);
  EXPECT_EQ(Json::parse(outcome.out)["output"], "a.isb");
  EXPECT_GE(outcome.errorLines(), 1);
  expectContains("\n" + outcome.err, "\nprogress 0.");
  expectContains(outcome.err, " bricks\n");
}

TEST_F(BuildCommandTest, PreviewsComeWithALineForProgramsAndGo) {
  fs::create_directory(path("previews"));
  const Outcome outcome = run({"build", "phantom:sphere:160", "-o", "a.isb", "--progress-lines",
                               "--preview-folder", "previews", "--preview-share", "1"});
  EXPECT_EQ(outcome.status, 0);
  for (const char* line :
       {"\npreview 2 160 160 160 previews/1.isb\n", "\npreview 2 160 160 160 previews/3.isb\n"})
    expectContains("\n" + outcome.err, line);
  EXPECT_TRUE(fs::is_empty(path("previews")));
  runWell({"build", "phantom:sphere:160", "-o", "b.isb"});
  EXPECT_TRUE(readBytes(path("a.isb")) == readBytes(path("b.isb")));
  expectFailure(2, {"build", "phantom:sphere:160", "--preview-folder", "previews"},
                "goes with --progress-lines");
}

// A store's own level is there before the first voxel of the finest is read, and there is no other.
TEST_F(BuildCommandTest, ThePreviewOfAStoreIsALevelOfItsOwn) {
  fs::create_directory(path("previews"));
  runWell({"build", "phantom:sphere:160", "-o", "s.isb"});
  runWell({"convert", "s.isb", "--all-levels", "-o", "s.ome.zarr"});
  const Outcome outcome = run({"build", "s.ome.zarr", "-o", "a.isb", "--progress-lines",
                               "--preview-folder", "previews", "--preview-share", "1"});
  EXPECT_EQ(outcome.status, 0);
  const std::string err = "\n" + outcome.err;
  const std::size_t at = err.find("\npreview 2 160 160 160 previews/level.isb\n");
  ASSERT_NE(at, std::string::npos) << err;
  EXPECT_EQ(err.find("\npreview ", at + 1), std::string::npos) << err;
  EXPECT_LT(at, err.find(" bricks\n"));
  EXPECT_TRUE(fs::is_empty(path("previews")));
}

TEST_F(BuildCommandTest, APyramidOfAnotherInputNeedsForce) {
  makeVolume("a.nrrd");
  makeVolume("b.nrrd", "torus");
  runWell({"build", "a.nrrd", "-o", "x.isb"});
  const std::string good = readBytes(path("x.isb"));
  expectFailure(1, {"build", "b.nrrd", "-o", "x.isb"},
                "was made from 'a.nrrd'; replace it with --force");
  EXPECT_EQ(readBytes(path("x.isb")), good);
  runWell({"build", "b.nrrd", "-o", "x.isb", "--force"});
  EXPECT_NE(readBytes(path("x.isb")), good);
  // One that cannot be opened says nothing of its input.
  writeBytes(path("x.isb"), good.substr(0, good.size() / 2));
  expectFailure(1, {"build", "a.nrrd", "-o", "x.isb"}, "--force");
  runWell({"build", "a.nrrd", "-o", "x.isb", "--force"});
  EXPECT_EQ(readBytes(path("x.isb")), good);
}

// The same relative path in another folder is another file.
TEST_F(BuildCommandTest, ARelativePathIsNoProofOfTheSameInput) {
  for (const char* folder : {"anna", "bert", "out"}) fs::create_directory(path(folder));
  makeVolume("anna/scan.nrrd");
  makeVolume("bert/scan.nrrd", "torus");
  const auto buildIn = [&](const std::string& folder) {
    return wait(start({"/bin/sh", "-c", "cd $1 && exec $0 build scan.nrrd --out-dir ../out",
                       isobrickCommand(), folder}));
  };
  EXPECT_EQ(buildIn("anna").status, 0);
  const std::string good = readBytes(path("out/scan.isb"));
  checkFailure(buildIn("bert"), 1, "--force");
  EXPECT_EQ(readBytes(path("out/scan.isb")), good);
  // It need not be: the file shows it, or the path is absolute.
  EXPECT_EQ(buildIn("anna").status, 0);
  runWell({"build", path("bert/scan.nrrd"), "--out-dir", "out", "--force"});
  touch("bert/scan.nrrd");
  EXPECT_FALSE(isSkipped({"build", path("bert/scan.nrrd"), "--out-dir", "out"}));
}

TEST_F(BuildCommandTest, AnInputIsNeverReplacedAndOtherFilesNeedForce) {
  makeVolume("a.nrrd");
  const std::string volume = readBytes(path("a.nrrd"));
  for (const char* force : {"--json", "--force"}) {
    expectFailure(1, {"build", "a.nrrd", "-o", "a.nrrd", force}, "input");
    expectFailure(1, {"build", "a.nrrd", "-o", "./a.nrrd", force}, "input");
  }
  writeBytes(path("precious.raw"), "not a pyramid");
  expectFailure(1, {"build", "a.nrrd", "-o", "precious.raw"}, "exists already");
  EXPECT_EQ(readBytes(path("precious.raw")), "not a pyramid");
  EXPECT_EQ(readBytes(path("a.nrrd")), volume);
  writeBytes(path("empty.isb"), "");
  expectFailure(1, {"build", "a.nrrd", "-o", "empty.isb"}, "exists already");
  runWell({"build", "a.nrrd", "-o", "empty.isb", "--force"});
}

TEST_F(BuildCommandTest, WrongUsage) {
  makeVolume("a.nrrd");
  fs::create_directory(path("other"));
  fs::copy_file(path("a.nrrd"), path("other/a.nrrd"));
  const std::vector<std::pair<Words, std::string>> cases = {
      {{"a.nrrd", "--memory", ""}, "--memory"},
      {{"a.nrrd", "--memory", "0"}, "'0'"},
      {{"a.nrrd", "--memory", "much"}, "much"},
      {{"a.nrrd", "--memory", "12XB"}, "12XB"},
      {{"a.nrrd", "--memory", "-1G"}, "-1G"},
      {{"a.nrrd", "--memory", "1.5"}, "1.5"},
      {{"a.nrrd", "--memory", "1e30G"}, "1e30G"},
      {{"a.nrrd", "--codec", "gzip"}, "gzip"},
      {{"a.nrrd", "-o", ""}, "empty"},
      {{"a.nrrd", "--out-dir", ""}, "empty"},
      {{"a.nrrd", "-o", "x.isb", "--out-dir", "other"}, "excludes"},
      {{"a.nrrd", "b.nrrd", "-o", "x.isb"}, "--out-dir"},
      {{"*/a.nrrd", "b.nrrd", "-o", "x.isb"}, "2 inputs"},
      {{"a.nrrd", "other/a.nrrd", "-o", "x.isbs"}, "of one volume, and there are 2 inputs"},
      {{"a.nrrd", "other/a.nrrd", "-o", "{name}.isbs"}, "of one volume, and there are 2 inputs"},
      {{"a.nrrd", "a.nrrd"}, "'a.nrrd' is given twice"},
      {{"a.nrrd", "other/a.nrrd"}, "'a.nrrd' and 'other/a.nrrd' would both become 'a.isb'"},
      {{"a.nrrd", "other/*", "--out-dir", "new"}, "would both become 'new/a.isb'"},
      {{"a.nrrd", "scan.raw"}, "--raw-dims"},
  };
  writeBytes(path("scan.raw"), "");
  for (auto [words, message] : cases) {
    words.insert(words.begin(), "build");
    expectFailure(2, words, message);
  }
}

TEST_F(BuildCommandTest, AMemoryBoundDoesNotChangeTheResultAndTooLittleIsRefused) {
  makeVolume("a.nrrd", "torus", 96);
  runWell({"build", "a.nrrd", "--brick", "32"});
  const std::string expected = readBytes(path("a.isb"));
  const Words words = {"build", "a.nrrd", "--brick", "32", "-o", "b.isb", "--memory"};
  const auto with = [&](const std::string& memory) {
    Words more = words;
    more.push_back(memory);
    return more;
  };
  expectFailure(1, with("65536"), "too small");
  const std::string message = run(with("64K")).err;
  // "...; allow 12M or more; give so much with --memory": that is enough, and says so.
  EXPECT_NE(message.find("--memory"), std::string::npos) << message;
  const std::size_t at = message.find("allow ") + 6;
  const std::string enough = message.substr(at, message.find(' ', at) - at);
  const Json built = runForJson(with(enough));
  EXPECT_EQ(built["memory_bytes"], std::stoull(enough) << 20);
  EXPECT_EQ(readBytes(path("b.isb")), expected);
}

// Whichever allocation fails: one error that says what to do, and nothing is left but what --resume
// goes on from.
TEST_F(BuildCommandTest, WhereTheSystemGivesLessThanTheBoundTheMessageSaysSo) {
  makeVolume("a.nrrd", "gyroid", 24);
  const Words words = {"build", "a.nrrd",    "--brick", "16",      "--memory",
                       "8M",    "--threads", "1",       "--codec", "none"};
  runWell(words);
  const std::string expected = readBytes(path("a.isb"));
  fs::remove(path("a.isb"));
  const std::set<std::string> before = files();
  const auto runWithout = [&](int allocation, Words more) {
    more.insert(more.begin(), {isobrickWithFaults(), "memory:" + std::to_string(allocation)});
    return wait(start(std::move(more)));
  };
  int failed = 0;
  for (;;) {
    const Outcome outcome = runWithout(failed + 1, words);
    if (outcome.status == 0) break;  // it takes no more than that
    ++failed;
    checkFailure(outcome, 1, "not enough memory for 'a.nrrd'");
    expectContains(outcome.err, "give a smaller --memory or fewer --threads");
    if (fs::exists(path("a.isb.partial"))) {
      expectContains(outcome.err, "go on with --resume");
      Words resume = words;
      resume.push_back("--resume");
      runWell(resume);
      EXPECT_EQ(readBytes(path("a.isb")), expected) << failed;
      fs::remove(path("a.isb"));
    } else {
      expectContains(outcome.err,
                     "the system gives less than the 8.00 MiB that --memory allows; give");
    }
    EXPECT_EQ(files(), before) << failed;
  }
  EXPECT_GT(failed, 5);
  // Those that come after it in a list have their turn.
  makeVolume("b.nrrd", "gyroid", 24);
  const Outcome both = runWithout(1, {"build", "a.nrrd", "b.nrrd"});
  EXPECT_EQ(both.status, 1);
  EXPECT_EQ(both.errorLines(), 2) << both.err;
}

TEST_F(BuildCommandTest, CodecsAreNamedInWhatIsPrinted) {
  makeVolume("a.nrrd", "head", 64);
  for (const char* codec : {"none", "lz4", "zstd"}) {
    EXPECT_EQ(runForJson({"build", "a.nrrd", "--codec", codec})["codec"], codec);
    expectContains(runWell({"build", "a.nrrd", "--codec", codec, "--rebuild"}),
                   std::string("codec ") + codec);
    runWell({"verify", "a.isb"});
  }
}

TEST_F(BuildCommandTest, OneVolumeAsTextAndAsJson) {
  makeVolume("a.nrrd", "head", 64);
  const std::string summary = runWell({"build", "a.nrrd"});
  EXPECT_LE(std::count(summary.begin(), summary.end(), '\n'), 5) << summary;
  EXPECT_EQ(summary.find("phase"), std::string::npos) << summary;
  const std::string text = runWell({"build", "a.nrrd", "--rebuild", "--verbose"});
  for (const char* part : {"a.isb: 64 x 64 x 64 uint16, 7 levels", "x raw), codec lz4", "phase",
                           "busy s", "MB/s", "read", "low-pass", "ranges", "curvature", "pack",
                           "write", "publish", "(open ", "peak memory", "--memory 1.00 GiB"})
    expectContains(text, part);
  const Json json = runForJson({"build", "a.nrrd", "--rebuild", "--threads", "2"});
  EXPECT_EQ(json["input"], "a.nrrd");
  EXPECT_EQ(json["output"], "a.isb");
  EXPECT_EQ(json["skipped"], false);
  EXPECT_EQ(json["memory_bytes"], 1u << 30);
  EXPECT_EQ(json["bricks"], 7);
  EXPECT_EQ(json["bricks_resumed"], 0);
  for (const char* key : {"total", "open", "build"}) EXPECT_GT(json["seconds"][key], 0) << key;
  EXPECT_GE(json["seconds"]["total"], json["seconds"]["build"]);
  for (const char* name : {"read", "ranges", "curvature", "pack", "write", "publish"}) {
    const Json& phase = json["phases"][name];
    EXPECT_GT(phase["busy_seconds"], 0) << name;
    EXPECT_NEAR(phase["megabytes_per_second"].get<double>() * phase["busy_seconds"].get<double>(),
                64 * 64 * 64 * 2 / 1e6, 1e-6)
        << name;
  }
  EXPECT_GT(json["megabytes_per_second"], 0);
  EXPECT_GT(json["peak_rss_bytes"], 0);
  // A build that was skipped has the same keys.
  const Json skipped = runForJson({"build", "a.nrrd"});
  for (const auto& [key, value] : json.items()) EXPECT_TRUE(skipped.contains(key)) << key;
  EXPECT_EQ(skipped["bytes"], json["bytes"]);
  EXPECT_TRUE(skipped["megabytes_per_second"].is_null());
}

TEST_F(BuildCommandTest, TheFolderForPyramids) {
  makeVolume("a.nrrd");
  writeBytes(path("file"), "");
  EXPECT_EQ(runForJson({"build", "a.nrrd", "--out-dir", "new"})["output"], "new/a.isb");
  EXPECT_EQ(runForJson({"build", "a.nrrd", "--out-dir", "new/", "--rebuild"})["output"],
            "new/a.isb");
  expectFailure(1, {"build", "a.nrrd", "--out-dir", "x/y"}, "create the folder above it");
  expectFailure(1, {"build", "a.nrrd", "--out-dir", "file"}, "is not a folder");
  // A folder in which nothing came to be goes again.
  expectFailure(1, {"build", "missing.nrrd", "--out-dir", "empty"}, "missing.nrrd");
}

TEST_F(BuildCommandTest, PatternsThatNoShellExpanded) {
  fs::create_directory(path("scans"));
  for (const char* name : {"b", "a", "c"}) makeVolume(std::string("scans/") + name + ".nrrd");
  const Json built = runForJson({"build", "scans/*.nrrd", "--out-dir", "out"});
  ASSERT_EQ(built["volumes"].size(), 3u);
  EXPECT_EQ(built["volumes"][0]["input"], "scans/a.nrrd");
  EXPECT_EQ(built["volumes"][2]["output"], "out/c.isb");
  expectFailure(1, {"build", "scans/*.mhd", "a.nrrd"}, "nothing matches the input 'scans/*.mhd'");
  expectFailure(1, {"build", "nowhere/[ab].nrrd"}, "nowhere/[ab].nrrd");
  // However many match, the output has the same form.
  EXPECT_EQ(runForJson({"build", "scans/[a].nrrd", "-o", "x.isb"})["volumes"].size(), 1u);
  // A file of that very name is no pattern.
  makeVolume("scans/[a].nrrd");
  EXPECT_EQ(runForJson({"build", "scans/[a].nrrd"})["output"], "[a].isb");
}

TEST_F(BuildCommandTest, OneOfManyFails) {
  makeVolume("a.nrrd", "head", 48);
  writeBytes(path("b.nrrd"), "no volume");
  makeVolume("c.mhd", "torus");
  const Words words = {"build", "a.nrrd", "b.nrrd", "missing.nrrd", "c.mhd"};
  const Outcome outcome = run(words);
  EXPECT_EQ(outcome.status, 1);
  EXPECT_EQ(outcome.errorLines(), 2) << outcome.err;
  expectContains(outcome.err, "isobrick: cannot read 'b.nrrd'");
  expectContains(outcome.err, "missing.nrrd");
  for (const char* part :
       {"a.isb: 48 x 48 x 48 uint16, ", "b.nrrd: FAILED: cannot read 'b.nrrd'",
        "missing.nrrd: FAILED", "c.isb: 32 x 32 x 32 float32, ", "\ninput ", "  state\n",
        "  built\n", "  FAILED\n", "\ntotal ", "of 4 volumes 2 built, 0 up to date, 2 failed in "})
    expectContains(outcome.out, part);
  runWell({"verify", "a.isb"});
  runWell({"verify", "c.isb"});

  const auto [json, again] = runListForJson(words, 1);
  EXPECT_EQ(again.errorLines(), 2) << again.err;
  ASSERT_EQ(json["volumes"].size(), 4u);
  EXPECT_EQ(json["volumes"][0]["skipped"], true);
  EXPECT_EQ(json["volumes"][1]["input"], "b.nrrd");
  expectContains(json["volumes"][1]["error"], "b.nrrd");
  EXPECT_EQ(json["volumes"][3]["output"], "c.isb");
  EXPECT_EQ(json["built"], 0);
  EXPECT_EQ(json["skipped"], 2);
  EXPECT_EQ(json["failed"], 2);
  EXPECT_GT(json["seconds"], 0);
}

TEST_F(BuildCommandTest, AllOfManyBuiltOrSkippedIsSuccess) {
  makeVolume("a.nrrd");
  makeVolume("b.nrrd", "torus");
  const Words words = {"build", "a.nrrd", "b.nrrd", "--brick", "16"};
  EXPECT_EQ(runForJson(words)["built"], 2);
  touch("b.nrrd");
  const std::string text = runWell(words);
  expectContains(text, "a.isb: skipped: up to date\n");
  expectContains(text, "  up to date\n");
  expectContains(text, "of 2 volumes 1 built, 1 up to date, 0 failed in ");
  EXPECT_EQ(runForJson(words)["skipped"], 2);
  // The same bytes as alone.
  runWell({"build", "b.nrrd", "--brick", "16", "-o", "alone.isb"});
  EXPECT_EQ(readBytes(path("alone.isb")), readBytes(path("b.isb")));
}

TEST_F(BuildCommandTest, RawOptionsHoldForAllInputs) {
  writeBytes(path("a.raw"), std::string(4 * 5 * 6, '\1'));
  writeBytes(path("b.raw"), std::string(4 * 5 * 6, '\2'));
  writeBytes(path("c.raw"), std::string(4 * 5 * 7, '\3'));
  const auto [json, outcome] =
      runListForJson({"build", "?.raw", "--raw-dims", "4,5,6", "--raw-type", "u8"}, 1);
  EXPECT_EQ(json["built"], 2);
  EXPECT_EQ(json["failed"], 1);
  expectContains(json["volumes"][2]["error"], "c.raw");
}

// A terminal for the progress bar, and all that was drawn on it.
class Terminal {
 public:
  Terminal() : master_(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    EXPECT_EQ(grantpt(master_), 0);
    EXPECT_EQ(unlockpt(master_), 0);
    slave_ = open(name().c_str(), O_RDWR | O_NOCTTY);  // keeps what others write
  }
  ~Terminal() {
    close(slave_);
    close(master_);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  std::string name() const { return ptsname(master_); }
  std::string text() const {
    std::string text(4096, '\0');
    const ssize_t got = read(master_, text.data(), text.size());
    text.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
    return text;
  }

 private:
  int master_, slave_ = -1;
};

TEST_F(BuildCommandTest, TheProgressBarOfAList) {
  makeVolume("a.nrrd");
  makeVolume("b.nrrd", "torus");
  const Terminal terminal;
  const Outcome outcome = wait(start(
      {"/bin/sh", "-c", "exec $0 build a.nrrd b.nrrd 2>$1", isobrickCommand(), terminal.name()}));
  EXPECT_EQ(outcome.status, 0);
  const std::string drawn = terminal.text();
  expectContains(drawn, "[1/2] a.nrrd  bricks  ");
  expectContains(drawn, "[2/2] b.nrrd  bricks  ");
}

TEST_F(BuildCommandTest, WhatThePlaceOfTheInputSaysBeforeItIsOpenedFailsAlone) {
  makeVolume("a.nrrd");
  writeBytes(path("b.isb"), "");
  ASSERT_EQ(mkfifo(path("pipe.nrrd").c_str(), 0600), 0);
  const auto [json, outcome] = runListForJson({"build", "b.isb", "pipe.nrrd", "a.nrrd"}, 1);
  EXPECT_EQ(json["failed"], 2);
  EXPECT_EQ(json["built"], 1);
}

}  // namespace
}  // namespace isobrick
