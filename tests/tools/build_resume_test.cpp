// Builds that are killed, interrupted or out of space, and what follows them.
#include <chrono>
#include <csignal>
#include <cstdint>

#include "tests/support/command_test.h"
#include "tests/support/test_paths.h"

namespace isobrick {
namespace {

using namespace test;

// The volume is small enough for a test and its bricks and windows are smaller, so that a build has
// many moments at which it can end.
class BuildResumeTest : public CommandTest {
 protected:
  void makeVolume(const std::string& name = "g.nrrd", int size = 160) {
    runWell({"phantom", "gyroid", "--voxels", std::to_string(size), "-o", name, "--force"});
  }
  static Words buildWords(Words more = {}) {
    Words words = {"build", "g.nrrd", "--brick", "16", "--memory", "8M", "--threads", "1"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  Outcome runWithFault(const std::string& fault, Words words) {
    words.insert(words.begin(), {isobrickWithFaults(), fault});
    return wait(start(std::move(words)));
  }
  static std::string signalAt(int signal_number, int change) {
    return "signal:" + std::to_string(signal_number) + ":" + std::to_string(change);
  }
  // Some bricks are written by then, and many are not.
  static constexpr int kSomeChanges = 400;
  void interruptBuild(int signal_number = SIGINT) {
    checkFailure(runWithFault(signalAt(signal_number, kSomeChanges), buildWords()), 130,
                 "% of the bricks are kept in 'g.isb.partial'; go on with --resume");
  }
  void killBuild() {
    EXPECT_EQ(runWithFault(signalAt(SIGKILL, kSomeChanges), buildWords()).status, -SIGKILL);
  }
  // The bytes of a build that nobody disturbed.
  std::string undisturbed() {
    runWell(buildWords({"-o", "whole.isb"}));
    std::string bytes = readBytes(path("whole.isb"));
    fs::remove(path("whole.isb"));
    return bytes;
  }
};

// The files of a killed build differ only by its last call to the file system: so one kill
// before each such call is every moment.
TEST_F(BuildResumeTest, KilledAtAnyMomentItGoesOn) {
  makeVolume("g.nrrd", 24);
  const std::string expected = undisturbed();
  const std::set<std::string> before = files();
  int kills = 0, resumed = 0;
  for (bool is_killed = true; is_killed;) {
    const Outcome outcome = runWithFault(signalAt(SIGKILL, kills + 1), buildWords({"--resume"}));
    is_killed = outcome.status == -SIGKILL;
    ASSERT_TRUE(is_killed || outcome.status == 0) << outcome.status << " " << outcome.err;
    kills += is_killed ? 1 : 0;
    // Under the pyramid's name there is a whole one or none.
    const bool was_published = fs::exists(path("g.isb"));
    EXPECT_TRUE(!was_published || readBytes(path("g.isb")) == expected) << kills;
    const Json json = runForJson(buildWords({"--resume"}));
    resumed += json["bricks_resumed"].get<std::uint64_t>() > 0 ? 1 : 0;
    EXPECT_EQ(readBytes(path("g.isb")), expected) << kills;
    fs::remove(path("g.isb"));
    EXPECT_EQ(files(), before) << kills;
  }
  EXPECT_GT(kills, 20);
  EXPECT_GT(resumed, 5);
}

TEST_F(BuildResumeTest, KilledAgainAndAgainItGoesOn) {
  makeVolume();
  const std::string expected = undisturbed();
  int kills = 0;
  while (runWithFault(signalAt(SIGKILL, kSomeChanges), buildWords({"--resume"})).status ==
         -SIGKILL) {
    ++kills;
    EXPECT_FALSE(fs::exists(path("g.isb")));
  }
  EXPECT_GT(kills, 2);
  EXPECT_EQ(readBytes(path("g.isb")), expected);
  EXPECT_EQ(files(), (std::set<std::string>{"g.isb", "g.nrrd"}));
}

TEST_F(BuildResumeTest, CtrlCKeepsWhatIsDone) {
  makeVolume();
  const std::string expected = undisturbed();
  const std::set<std::string> before = files();
  for (const int signal_number : {SIGINT, SIGTERM, SIGHUP}) {
    interruptBuild(signal_number);
    std::set<std::string> kept = before;
    kept.insert({"g.isb.partial", "g.isb.partial.journal"});
    EXPECT_EQ(files(), kept);
    // With other threads and another memory it is the same build.
    const Outcome outcome = run({"build", "g.nrrd", "--brick", "16", "--resume"});
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_NE(outcome.out.find("resumed: "), std::string::npos) << outcome.out;
    EXPECT_EQ(readBytes(path("g.isb")), expected);
    fs::remove(path("g.isb"));
    EXPECT_EQ(files(), before);
  }
}

TEST_F(BuildResumeTest, WithoutResumeItBeginsAnewAndCleansUp) {
  makeVolume();
  const std::string expected = undisturbed();
  killBuild();
  const Json json = runForJson(buildWords());
  EXPECT_EQ(json["bricks_resumed"], 0);
  EXPECT_EQ(readBytes(path("g.isb")), expected);
  EXPECT_EQ(files(), (std::set<std::string>{"g.isb", "g.nrrd"}));
}

TEST_F(BuildResumeTest, ResumeWithNothingThereIsABuild) {
  makeVolume("g.nrrd", 48);
  EXPECT_EQ(runForJson(buildWords({"--resume"}))["bricks_resumed"], 0);
}

// A kill after the pyramid got its name leaves the journal alone.
TEST_F(BuildResumeTest, AJournalWithoutAnUnfinishedPyramidMeansNothing) {
  makeVolume();
  const std::string expected = undisturbed();
  interruptBuild();
  fs::remove(path("g.isb.partial"));
  const std::string journal = readBytes(path("g.isb.partial.journal"));
  const std::set<std::string> published{"g.isb", "g.nrrd"};
  // Another codec: as a build to go on with, it would be refused.
  runWell(buildWords({"--resume", "--codec", "zstd"}));
  EXPECT_EQ(files(), published);
  runWell(buildWords({"--rebuild"}));
  EXPECT_EQ(readBytes(path("g.isb")), expected);

  for (const Words& words : {buildWords(), buildWords({"--resume"})}) {
    writeBytes(path("g.isb.partial.journal"), journal);
    EXPECT_EQ(runForJson(words)["skipped"], true);
    EXPECT_EQ(files(), published);
  }
  // With one it belongs to somebody.
  writeBytes(path("g.isb.partial.journal"), journal);
  writeBytes(path("g.isb.partial"), "half of something");
  runWell(buildWords());
  EXPECT_EQ(readBytes(path("g.isb.partial")), "half of something");
  EXPECT_EQ(readBytes(path("g.isb.partial.journal")), journal);
}

TEST_F(BuildResumeTest, OtherOptionsAreRefusedByName) {
  makeVolume();
  interruptBuild();
  expectFailure(1, buildWords({"--resume", "--codec", "zstd"}), "codec=zstd (it was codec=lz4)");
  expectFailure(1, buildWords({"--resume", "--no-curvature"}), "curvature=none (it was curvature=");
  expectFailure(1, buildWords({"--resume", "--tile", "8"}), "tile=8 (it was tile=4)");
  runWell(buildWords({"--resume"}));
}

TEST_F(BuildResumeTest, AnotherInputIsRefused) {
  makeVolume();
  interruptBuild();
  const std::string volume = readBytes(path("g.nrrd"));
  fs::last_write_time(path("g.nrrd"),
                      fs::last_write_time(path("g.nrrd")) + std::chrono::seconds(5));
  expectFailure(1, buildWords({"--resume"}), "input=1 files");
  writeBytes(path("g.nrrd"), volume.substr(0, volume.size() - 1000));
  expectFailure(1, buildWords({"--resume"}), "g.nrrd");
  runWell({"phantom", "torus", "--voxels", "160", "--type", "u8", "-o", "g.nrrd", "--force"});
  expectFailure(1, buildWords({"--resume"}), "input=1 files");
}

TEST_F(BuildResumeTest, CtrlCStopsAWholeList) {
  for (const char* name : {"a.nrrd", "c.nrrd"}) makeVolume(name, 32);
  makeVolume("g.nrrd");
  const Words words = {"build", "a.nrrd",   "g.nrrd", "c.nrrd",    "--brick",
                       "16",    "--memory", "8M",     "--threads", "1"};
  const auto interruptedRun = [&](const Words& more) {
    Words all = words;
    all.insert(all.end(), more.begin(), more.end());
    return runWithFault(signalAt(SIGINT, kSomeChanges), all);
  };
  const Outcome text = interruptedRun({});
  EXPECT_EQ(text.status, 130);
  EXPECT_EQ(text.errorLines(), 1) << text.err;
  for (const char* part : {"isobrick: 'g.nrrd': interrupted; ", "'g.isb.partial'",
                           "of 3 volumes 1 built, 0 up to date, 0 failed, 2 not done"})
    EXPECT_NE(text.err.find(part), std::string::npos) << text.err;
  EXPECT_NE(text.out.find("  interrupted\n"), std::string::npos) << text.out;
  EXPECT_FALSE(fs::exists(path("c.isb")));

  for (const char* name : {"g.isb.partial", "g.isb.partial.journal"}) fs::remove(path(name));
  const Outcome json_run = interruptedRun({"--json"});
  EXPECT_EQ(json_run.status, 130);
  const Json json = Json::parse(json_run.out);
  EXPECT_EQ(json["volumes"].size(), 2u);
  EXPECT_EQ(json["skipped"], 1);
  EXPECT_EQ(json["interrupted"], true);

  Words resume = words;
  resume.push_back("--resume");
  const Json resumed = runForJson(resume);
  EXPECT_EQ(resumed["built"], 2);
  EXPECT_GT(resumed["volumes"][1]["bricks_resumed"], 0);
}

TEST_F(BuildResumeTest, AFullDiskKeepsWhatIsDone) {
  makeVolume();
  const std::string expected = undisturbed();
  ASSERT_GT(expected.size(), std::size_t{1200} << 10);
  // Packed, it may fit for all that is known beforehand.
  checkFailure(runWithFault("disk:1200000", buildWords()), 1, "go on with --resume");
  EXPECT_TRUE(fs::exists(path("g.isb.partial")));
  // Still full.
  checkFailure(runWithFault("disk:0", buildWords({"--resume"})), 1, "g.isb");
  Words words = buildWords({"--resume", "--json"});
  const Outcome outcome = runWithFault("disk:33000000", words);
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_GT(Json::parse(outcome.out)["bricks_resumed"], 0);
  EXPECT_EQ(readBytes(path("g.isb")), expected);
  // A pyramid that cannot fit is refused before the work.
  fs::remove(path("g.isb"));
  const std::set<std::string> before = files();
  checkFailure(runWithFault("disk:6000000", buildWords({"--codec", "none"})), 1,
               "not enough space");
  EXPECT_EQ(files(), before);
}

TEST_F(BuildResumeTest, LittleSpaceIsToldInSmallUnits) {
  makeVolume("g.nrrd", 24);
  // Enough for the header and the journal, and less than a block.
  const Outcome outcome = runWithFault("disk:3000", buildWords());
  checkFailure(outcome, 1, "not enough space");
  EXPECT_EQ(outcome.err.find(" 0 MiB"), std::string::npos) << outcome.err;
  EXPECT_NE(outcome.err.find(" KiB and the disk has 1 KiB"), std::string::npos) << outcome.err;
}

// However much fits: one error, and nothing is left or what is left is good for going on.
TEST_F(BuildResumeTest, ADiskThatIsFullAtAnyByteGivesOneError) {
  makeVolume("g.nrrd", 24);
  const std::string expected = undisturbed();
  const std::set<std::string> before = files();
  std::set<std::string> kept = before;
  kept.insert({"g.isb.partial", "g.isb.partial.journal"});
  int failed = 0, resumed = 0;
  for (std::size_t bytes = 0; bytes < 4 * expected.size(); bytes += 1 + bytes / 4) {
    const Outcome outcome = runWithFault("quota:" + std::to_string(bytes), buildWords());
    if (outcome.status == 0) break;
    checkFailure(outcome, 1, "g.isb");
    ++failed;
    EXPECT_TRUE(files() == before || files() == kept) << bytes;
    const Json json = runForJson(buildWords({"--resume"}));
    resumed += json["bricks_resumed"].get<std::uint64_t>() > 0 ? 1 : 0;
    EXPECT_EQ(readBytes(path("g.isb")), expected) << bytes;
    fs::remove(path("g.isb"));
    EXPECT_EQ(files(), before) << bytes;
  }
  EXPECT_GT(failed, 15);
  EXPECT_GT(resumed, 0);
}

}  // namespace
}  // namespace isobrick
