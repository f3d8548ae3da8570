// `isobrick verify --repair` from outside, and damaged pyramids in the commands that read them.
#include <algorithm>
#include <string>

#include "tests/support/byte_damage.h"
#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class RepairCommandTest : public CommandTest {
 protected:
  RepairCommandTest() {
    runWell({"phantom", "head", "--voxels", "24", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd", "--brick", "8"});
    good_ = readBytes(path("head.isb"));
  }
  // In the samples of the first brick.
  void damage() {
    std::string bad = good_;
    bad[600] = static_cast<char>(bad[600] ^ 4);
    writeBytes(path("head.isb"), bad);
  }
  bool isAsItWas() const { return readBytes(path("head.isb")) == good_; }

  std::string good_;
};

TEST_F(RepairCommandTest, PutsTheBytesBackFromTheSource) {
  EXPECT_NE(runWell({"verify", "head.isb", "--repair", "auto"}).find("are whole"),
            std::string::npos);
  for (const char* const source : {"head.nrrd", "auto"}) {
    damage();
    EXPECT_NE(runWell({"verify", "head.isb", "--repair", source}).find("repaired"),
              std::string::npos);
    EXPECT_TRUE(isAsItWas());
  }
  // Cut off, tables and all.
  writeBytes(path("head.isb"), good_.substr(0, 700));
  runWell({"verify", "head.isb", "--repair", "head.nrrd"});
  EXPECT_TRUE(isAsItWas());
  damage();
  const Json json = runForJson({"verify", "head.isb", "--repair", "auto"});
  EXPECT_EQ(json["whole"], true);
  EXPECT_EQ(json["repair"]["mended"].size(), 1u);
  EXPECT_EQ(files(), (std::set<std::string>{"head.isb", "head.nrrd"}));
}

TEST_F(RepairCommandTest, NamesWhatIsLost) {
  damage();
  const std::string bad = readBytes(path("head.isb"));
  fs::remove(path("head.nrrd"));
  const Outcome lost = run({"verify", "head.isb", "--repair", "auto"});
  EXPECT_EQ(lost.status, 1);
  EXPECT_NE(lost.err.find("level 0, brick (0,0,0): lost, with the voxels (0,0,0) to (7,7,7)"),
            std::string::npos)
      << lost.err;
  EXPECT_TRUE(readBytes(path("head.isb")) == bad);
  // Another volume, and none.
  runWell({"phantom", "sphere", "--voxels", "24", "--type", "i16", "-o", "other.nrrd"});
  for (const char* const other : {"other.nrrd", "none.nrrd"}) {
    const Outcome refused = run({"verify", "head.isb", "--repair", other});
    EXPECT_EQ(refused.status, 1);
    EXPECT_NE(refused.err.find(other), std::string::npos) << refused.err;
    EXPECT_TRUE(readBytes(path("head.isb")) == bad);
  }
  expectFailure(1, {"verify", "none.isb", "--repair", "auto"}, "none.isb");
  expectFailure(2, {"verify", "head.isb", "--spacing", "1,1,1"}, "--repair");
  expectFailure(2, {"verify", "http://127.0.0.1:1/a.isb", "--repair", "auto"}, "--repair");
}

TEST_F(RepairCommandTest, KilledItLeavesTheOldFileOrTheNewOne) {
  damage();
  const std::string bad = readBytes(path("head.isb"));
  for (const int milliseconds : {1, 10, 30, 60, 90, 120}) {
    writeBytes(path("head.isb"), bad);
    const pid_t pid = start({isobrickCommand(), "verify", "head.isb", "--repair", "head.nrrd"});
    usleep(1000 * static_cast<useconds_t>(milliseconds));
    kill(pid, SIGKILL);
    wait(pid);
    EXPECT_TRUE(isAsItWas() || readBytes(path("head.isb")) == bad);
  }
  runWell({"verify", "head.isb", "--repair", "head.nrrd"});
  writeBytes(path("head.isb"), bad);
  runWell({"verify", "head.isb", "--repair", "head.nrrd"});
  EXPECT_TRUE(isAsItWas());
  EXPECT_EQ(files(), (std::set<std::string>{"head.isb", "head.nrrd"}));
}

TEST_F(RepairCommandTest, DividedPyramids) {
  runWell({"build", "head.nrrd", "-o", "head.isbs", "--brick", "8", "--super-brick", "16"});
  const std::string file = path("head.isbs/1-0-0.isb"), good = readBytes(file),
                    index = readBytes(path("head.isbs/index.isb"));
  std::string bad = good;
  bad[600] = static_cast<char>(bad[600] ^ 4);
  writeBytes(file, bad);
  fs::remove(path("head.isbs/0-1-0.isb"));
  runWell({"verify", "head.isbs", "--repair", "head.nrrd"});
  EXPECT_TRUE(readBytes(file) == good);
  EXPECT_TRUE(readBytes(path("head.isbs/index.isb")) == index);
}

TEST_F(RepairCommandTest, Indexes) {
  runWell({"convert", "head.nrrd", "-o", "head.mhd"});
  runWell({"build", "head.mhd", "-o", "index.isb", "--brick", "8", "--index"});
  const std::string good = readBytes(path("index.isb"));
  std::string bad = good;
  for (const std::size_t at : {600u, 601u}) bad[at] = static_cast<char>(bad[at] ^ 4);
  writeBytes(path("index.isb"), bad);
  runWell({"verify", "index.isb", "--repair", "auto"});
  EXPECT_TRUE(readBytes(path("index.isb")) == good);
}

// A sample of tests/storage/every_byte_test.cpp by the commands themselves.
TEST_F(RepairCommandTest, CommandsSayOneErrorOrAreRight) {
  const std::vector<Words> commands = {
      {"extract", "head.isb", "--iso", "500", "-o", "out.ply", "--force"},
      {"convert", "head.isb", "--level", "0", "-o", "out.nrrd", "--force"},
      {"render", "head.isb", "--iso", "500", "--size", "32x32", "-o", "out.png", "--force"}};
  std::vector<std::string> right;
  for (const Words& words : commands) {
    runWell(words);
    right.push_back(readBytes(path(words[words.size() - 2])));
  }
  forSomeDamages(good_, 12, [&](std::size_t number) {
    writeBytes(path("head.isb"), damaged(good_, number));
    EXPECT_EQ(run({"verify", "head.isb"}).status, 1) << number;
    for (std::size_t i = 0; i < commands.size(); ++i) {
      fs::remove(path(commands[i][commands[i].size() - 2]));
      const Outcome outcome = run(commands[i]);
      if (outcome.status == 0)
        EXPECT_TRUE(readBytes(path(commands[i][commands[i].size() - 2])) == right[i]) << number;
      else
        checkFailure(outcome, 1, "head.isb", commands[i]);
    }
  });
}

}  // namespace
}  // namespace isobrick::test
