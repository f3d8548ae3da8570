// `isobrick build` with an output of many files, in parts, and all commands that read it.
#include <chrono>
#include <cstring>
#include <thread>

#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid_division.h"
#include "tests/support/command_test.h"
#include "tests/support/range_server.h"

namespace isobrick::test {
namespace {

class DividedBuildTest : public CommandTest {
 protected:
  void SetUp() override { runWell({"phantom", "head", "--voxels", "80", "-o", "head.nrrd"}); }

  Words build(const Words& more) const {
    Words words = {"build", "head.nrrd", "--brick", "8", "-o", "head.isbs", "--super-brick", "32"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  void buildParts(int of) {
    for (int number = of; number >= 1; --number)
      runWell(build({"--part", std::to_string(number) + "/" + std::to_string(of)}));
  }
  std::string inFolder(const std::string& name) const { return path("head.isbs/" + name); }
  void expectSameMesh(const Words& query) {
    for (const char* const pyramid : {"head.isb", "head.isbs"}) {
      Words words = {"extract", pyramid, "--iso", "900", "-o", std::string(pyramid) + ".ply",
                     "--force"};
      words.insert(words.end(), query.begin(), query.end());
      runWell(words);
    }
    EXPECT_TRUE(readBytes(path("head.isb.ply")) == readBytes(path("head.isbs.ply")));
    EXPECT_GT(readBytes(path("head.isb.ply")).size(), 10000u);
  }
};

TEST_F(DividedBuildTest, PartsAndTheJoinGiveThePyramidOfOneBuild) {
  runWell({"build", "head.nrrd", "--brick", "8"});
  buildParts(4);
  expectFailure(1, {"info", "head.isbs"}, "'head.isbs/index.isb'");
  const Json joined = runForJson({"merge", "head.isbs"})["join"];
  EXPECT_EQ(joined["super_bricks"], 27);
  const std::string index = readBytes(inFolder(kIndexName));
  runWell({"merge", "head.isbs"});
  EXPECT_TRUE(index == readBytes(inFolder(kIndexName)));

  const Json whole = runForJson({"info", "head.isb"}), divided = runForJson({"info", "head.isbs"});
  for (const char* key : {"dimensions", "value_range", "noise", "isovalues", "levels"})
    EXPECT_EQ(divided[key], whole[key]) << key;
  EXPECT_EQ(divided["division"]["files"], 27);
  EXPECT_EQ(divided["bytes"]["total"], joined["file_bytes"]);
  EXPECT_NE(runWell({"verify", "head.isbs"}).find("whole"), std::string::npos);
  expectSameMesh({});
  expectSameMesh({"--focus", "40,40,40", "--radius", "12"});
  expectSameMesh({"--level", "3"});
  for (const char* const pyramid : {"head.isb", "head.isbs"})
    runWell({"convert", pyramid, "-o", std::string(pyramid) + ".nrrd"});
  EXPECT_TRUE(readBytes(path("head.isb.nrrd")) == readBytes(path("head.isbs.nrrd")));
  // Shares of its surface.
  Words merge = {"merge", "-o", "merged.ply"};
  for (const char* part : {"1", "2"}) {
    merge.push_back(std::string(part) + ".isbm");
    runWell({"extract", "head.isbs", "--iso", "900", "--part", std::string(part) + "/2", "-o",
             merge.back()});
  }
  runWell(merge);
  runWell({"extract", "head.isb", "--iso", "900", "-o", "all.ply"});
  EXPECT_TRUE(readBytes(path("merged.ply")) == readBytes(path("all.ply")));
  // By one command, and with the folder's slash.
  runWell({"build", "head.nrrd", "--brick", "8", "-o", "again.isbs", "--super-brick", "32"});
  EXPECT_TRUE(index == readBytes(path(std::string("again.isbs/") + kIndexName)));
  EXPECT_EQ(runForJson({"info", "head.isbs/"})["levels"], whole["levels"]);
  EXPECT_EQ(runForJson({"info", "head.isbs/index.isb"})["levels"], whole["levels"]);
}

TEST_F(DividedBuildTest, WhatIsThereStaysAlsoAfterAKill) {
  const auto superBricks = [&] {
    std::size_t count = 0;
    for (const char* x : {"0", "1", "2"})
      for (const char* y : {"0", "1", "2"})
        for (const char* z : {"0", "1", "2"})
          count += fs::exists(inFolder(std::string(x) + "-" + y + "-" + z + ".isb")) ? 1 : 0;
    return count;
  };
  Words words = build({});
  words.insert(words.begin(), isobrickCommand());
  const pid_t pid = start(words);
  while (superBricks() < 2) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  kill(pid, SIGKILL);
  wait(pid);
  const std::size_t there = superBricks();
  const auto first = fs::last_write_time(inFolder("0-0-0.isb"));
  const Json rest = runForJson(build({"--part", "1/1"}));
  EXPECT_GE(rest["super_bricks"]["up_to_date"], std::min<std::size_t>(there, 27));
  EXPECT_EQ(
      rest["super_bricks"]["built"].get<int>() + rest["super_bricks"]["up_to_date"].get<int>(), 27);
  EXPECT_EQ(fs::last_write_time(inFolder("0-0-0.isb")), first);
  EXPECT_EQ(runForJson(build({}))["super_bricks"]["built"], 0);
  runWell({"verify", "head.isbs"});
}

// A file that was built by halves is that of one go, to the byte; and so another join finds the
// same files.
TEST_F(DividedBuildTest, CtrlCDoesNotWaitForAServer) {
  runWell(build({}));
  const RangeServer server(path(""));
  for (const char* command : {"extract", "verify"}) {
    Words words = {isobrickCommand(), command, server.url("index-only/head.isbs")};
    if (words[1] == "extract") words.insert(words.end(), {"--iso", "900"});
    const std::size_t before = server.requests();
    const pid_t pid = start(words);
    while (server.requests() < before + 4)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const auto begin = std::chrono::steady_clock::now();
    kill(pid, SIGINT);
    const Outcome outcome = wait(pid);
    // Far less than the time limit of a server that hangs.
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(10));
    EXPECT_EQ(outcome.status, 130);
    EXPECT_NE(outcome.err.find("interrupted"), std::string::npos) << outcome.err;
  }
}

// A file that was built by halves is that of one go, to the byte; and so another join finds the
// same.
TEST_F(DividedBuildTest, AResumedFileIsThatOfOneGo) {
  runWell(build({}));
  const std::string whole = readBytes(inFolder("0-1-1.isb"));
  for (int round = 0; round < 12; ++round) {
    fs::remove(inFolder("0-1-1.isb"));
    Words words = build({"--resume", "--threads", "1"});
    words.insert(words.begin(), isobrickCommand());
    const pid_t pid = start(words);
    const auto journal = inFolder("0-1-1.isb.partial.journal");
    std::error_code gone;
    while (!fs::exists(inFolder("0-1-1.isb")) &&
           !(fs::exists(journal) && fs::file_size(journal, gone) > 2000u + 300u * round))
      std::this_thread::yield();
    kill(pid, SIGKILL);
    wait(pid);
    runWell(build({"--resume"}));
    EXPECT_TRUE(readBytes(inFolder("0-1-1.isb")) == whole) << round;
  }
}

TEST_F(DividedBuildTest, DamagedFilesAreBuiltAgain) {
  runWell(build({}));
  const std::string index = readBytes(inFolder(kIndexName)),
                    file = readBytes(inFolder("1-0-2.isb"));
  const auto expectMended = [&](const std::string& name) {
    EXPECT_EQ(runForJson(build({}))["super_bricks"]["built"], name == kIndexName ? 0 : 1) << name;
    EXPECT_TRUE(readBytes(inFolder(kIndexName)) == index);
    EXPECT_TRUE(readBytes(inFolder("1-0-2.isb")) == file);
  };
  for (const std::string& name : {std::string(kIndexName), std::string("1-0-2.isb")}) {
    const std::string& good = name == kIndexName ? index : file;
    writeBytes(inFolder(name), good.substr(0, good.size() / 2));
    expectMended(name);
    writeBytes(inFolder(name), "");
    expectMended(name);
  }
  // The part of it that the join reads.
  format::Header header{};
  std::memcpy(&header, file.data(), sizeof header);
  std::string bad = file;
  bad[header.division.offset + header.division.stored_bytes / 2] ^= 1;
  writeBytes(inFolder("1-0-2.isb"), bad);
  expectFailure(1, {"merge", "head.isbs"}, "damaged table for the join");
  expectMended("1-0-2.isb");
  // Files that are not isobrick's stay.
  writeBytes(inFolder("1-0-2.isb"), "notes");
  expectFailure(1, build({}), "replace it with --force");
  runWell(build({"--force"}));
  expectMended(kIndexName);
}

TEST_F(DividedBuildTest, TheFolderMayHaveASlashAndIsNoFile) {
  runWell({"build", "head.nrrd", "--brick", "8", "-o", "slash.isbs/", "--super-brick", "64"});
  EXPECT_TRUE(fs::is_directory(path("slash.isbs")));
  writeBytes(path("file.isbs"), "x");
  expectFailure(1, {"build", "head.nrrd", "-o", "file.isbs"}, "'file.isbs' is a file");
  expectFailure(1, {"build", "head.nrrd", "--brick", "8", "-o", "x.isbs", "--super-brick", "1024"},
                "8 to 512 cells");
}

TEST_F(DividedBuildTest, WhatIsNoPyramidIsNamed) {
  expectFailure(1, {"merge", "nothing.isbs"}, "'nothing.isbs'");
  expectFailure(2, {"build", "head.nrrd", "--part", "1/2"}, "-o OUT.isbs");
  expectFailure(2, {"build", "head.nrrd", "-o", "x.isb", "--super-brick", "64"}, "-o OUT.isbs");
  for (const Words& more : {Words{"-o", "x.ply"}, {"--check"}, {"--unit", "mm", "-o", "x.ply"}}) {
    Words words = {"merge", "head.isbs"};
    words.insert(words.end(), more.begin(), more.end());
    expectFailure(2, words, "neither an output");
  }
  expectFailure(2, {"merge", "head.isbs", "a.isbm"}, "joined alone");
  expectFailure(2, {"merge", "a.isbm", "--memory", "1G"}, "--memory is for a pyramid");
  const Outcome old = run({"build", "nothing.isbs", "--join"});
  EXPECT_EQ(old.status, 1);
  EXPECT_NE(old.err.find("build --join is merge now"), std::string::npos) << old.err;
  expectFailure(1, {"build", "phantom:sphere:2", "-o", "small.isbs"}, "fits into one brick");
  buildParts(1);
  // One that is not there, one of another place, one of another build, one too many.
  fs::rename(inFolder("2-2-2.isb"), path("kept"));
  expectFailure(1, {"merge", "head.isbs"}, "lacks 1 of its 27 files: 2-2-2.isb");
  fs::copy_file(inFolder("0-0-0.isb"), inFolder("2-2-2.isb"));
  expectFailure(1, {"merge", "head.isbs"},
                "'head.isbs/2-2-2.isb' is the file of another super-brick");
  runWell({"build", "head.nrrd", "--brick", "8", "--codec", "none", "-o", "other.isbs",
           "--super-brick", "32"});
  fs::remove(inFolder("2-2-2.isb"));
  fs::copy_file(path("other.isbs/2-2-2.isb"), inFolder("2-2-2.isb"));
  expectFailure(1, {"merge", "head.isbs"}, "with other options");
  expectFailure(1, build({"--part", "1/1"}), "replace it with --force");
  fs::remove(inFolder("2-2-2.isb"));
  fs::rename(path("kept"), inFolder("2-2-2.isb"));
  fs::copy_file(inFolder("0-0-0.isb"), inFolder("3-0-0.isb"));
  expectFailure(1, {"merge", "head.isbs"}, "another division: 3-0-0.isb");
  fs::remove(inFolder("3-0-0.isb"));
  runWell({"merge", "head.isbs"});
  expectFailure(1, {"info", "head.isbs/0-0-0.isb"}, "one super-brick of a divided pyramid");
  expectFailure(1, {"build", "head.isbs", "-o", "y.isb"}, "is a pyramid already");

  // A lost file concerns what needs it.
  fs::rename(inFolder("1-1-1.isb"), path("kept"));
  const Words near = {"extract", "head.isbs", "--iso", "900", "--box", "0,0,0,30,60,60"};
  runWell(near);
  const Outcome info = run({"info", "head.isbs", "--json"});
  EXPECT_EQ(info.status, 1);
  EXPECT_EQ(Json::parse(info.out)["dimensions"], Json({80, 80, 80}));
  EXPECT_EQ(Json::parse(info.out)["bytes"], nullptr);
  EXPECT_NE(info.err.find("head.isbs/1-1-1.isb"), std::string::npos) << info.err;
  expectFailure(1, {"extract", "head.isbs", "--iso", "900"}, "1-1-1.isb");
  const Outcome lost = run({"verify", "head.isbs"});
  EXPECT_EQ(lost.status, 1);
  EXPECT_EQ(lost.errorLines(), 1) << lost.err;
  EXPECT_NE(lost.err.find("'head.isbs/1-1-1.isb'"), std::string::npos) << lost.err;
  EXPECT_NE(lost.out.find("are damaged or lost"), std::string::npos) << lost.out;
  // Another file in its place is not taken for it.
  fs::copy_file(path("other.isbs/1-1-1.isb"), inFolder("1-1-1.isb"));
  expectFailure(1, {"extract", "head.isbs", "--iso", "900"}, "is not the file that was joined");
}

}  // namespace
}  // namespace isobrick::test
