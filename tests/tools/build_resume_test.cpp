// Builds that are killed, interrupted or out of space, and what follows them.
#include <sys/mount.h>
#include <sys/stat.h>

#include <chrono>
#include <functional>
#include <thread>

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
    runWell({"phantom", "gyroid", "--size", std::to_string(size), "-o", name});
  }
  static Words buildWords(Words more = {}) {
    Words words = {"build", "g.nrrd", "--brick", "16", "--memory", "8M", "--threads", "1"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  pid_t startBuild(Words more = {}) {
    Words words = buildWords(std::move(more));
    words.insert(words.begin(), isobrickCommand());
    return start(std::move(words));
  }
  // Waits until so many bytes of a journal are there: each brick has 104.
  void waitForBricks(const std::string& output, std::uintmax_t bricks) {
    const auto working = [&] {
      std::error_code error;
      const auto bytes = fs::file_size(path(output + ".partial.journal"), error);
      return !error && bytes > bricks * 104 + 1000;
    };
    for (int wait_ms = 0; !working() && wait_ms < 20000; wait_ms += 1)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_TRUE(working());
  }
  void interruptBuild(int signal_number = SIGINT) {
    const pid_t pid = startBuild();
    waitForBricks("g.isb", 100);
    kill(pid, signal_number);
    checkFailure(wait(pid), 130,
                 "% of the bricks are kept in 'g.isb.partial': go on with --resume");
  }
  void killBuild() {
    const pid_t pid = startBuild();
    waitForBricks("g.isb", 100);
    kill(pid, SIGKILL);
    EXPECT_EQ(wait(pid).status, -SIGKILL);
  }
  // The bytes of a build that nobody disturbed.
  std::string undisturbed() {
    runWell(buildWords({"-o", "whole.isb"}));
    std::string bytes = readBytes(path("whole.isb"));
    fs::remove(path("whole.isb"));
    return bytes;
  }
};

TEST_F(BuildResumeTest, KilledAtAnyMomentItGoesOn) {
  makeVolume();
  const auto begin = std::chrono::steady_clock::now();
  const std::string expected = undisturbed();
  const auto whole = std::chrono::steady_clock::now() - begin;
  const std::set<std::string> before = files();
  std::uint64_t resumed = 0;
  for (int round = 0; round < 3; ++round) {
    // Killed twice, the second time while it goes on.
    for (const double share : {0.2 + 0.25 * round, 0.1 + 0.1 * round}) {
      const pid_t pid = startBuild({"--resume"});
      std::this_thread::sleep_for(whole * share);
      kill(pid, SIGKILL);
      wait(pid);
      // Under the pyramid's name there is a whole one or none.
      EXPECT_TRUE(!fs::exists(path("g.isb")) || readBytes(path("g.isb")) == expected);
    }
    const Json json = runForJson(buildWords({"--resume"}));
    resumed += json["bricks_resumed"].get<std::uint64_t>();
    EXPECT_EQ(readBytes(path("g.isb")), expected) << round;
    fs::remove(path("g.isb"));
    EXPECT_EQ(files(), before) << round;
  }
  EXPECT_GT(resumed, 0u);
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
  runWell({"phantom", "torus", "--size", "160", "--type", "u8", "-o", "g.nrrd"});
  expectFailure(1, buildWords({"--resume"}), "input=1 files");
}

TEST_F(BuildResumeTest, CtrlCStopsAWholeList) {
  for (const char* name : {"a.nrrd", "c.nrrd"}) makeVolume(name, 32);
  makeVolume("g.nrrd");
  const Words words = {"build", "a.nrrd",   "g.nrrd", "c.nrrd",    "--brick",
                       "16",    "--memory", "8M",     "--threads", "1"};
  const auto interruptedRun = [&](const Words& more) {
    Words all = words;
    all.insert(all.begin(), isobrickCommand());
    all.insert(all.end(), more.begin(), more.end());
    const pid_t pid = start(all);
    waitForBricks("g.isb", 100);
    kill(pid, SIGINT);
    return wait(pid);
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

// A file system of a few MiB that ends with the test.
class SmallDisk {
 public:
  SmallDisk(const std::string& path, const char* size) : path_(path) {
    fs::create_directory(path);
    is_mounted_ = mount("isobrick-test", path.c_str(), "tmpfs", 0, size) == 0;
  }
  ~SmallDisk() {
    if (is_mounted_) umount2(path_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  bool isMounted() const { return is_mounted_; }
  void resize(const char* size) const {
    EXPECT_EQ(mount("isobrick-test", path_.c_str(), "tmpfs", MS_REMOUNT, size), 0);
  }

 private:
  std::string path_;
  bool is_mounted_ = false;
};

TEST_F(BuildResumeTest, AFullDiskKeepsWhatIsDone) {
  const SmallDisk disk(path("disk"), "size=1200k");
  if (!disk.isMounted()) GTEST_SKIP() << "only root may mount a small disk";
  makeVolume();
  const std::string expected = undisturbed();
  ASSERT_GT(expected.size(), std::size_t{1200} << 10);
  // Packed, it may fit for all that is known beforehand.
  checkFailure(run(buildWords({"--out-dir", "disk"})), 1, "go on with --resume");
  EXPECT_TRUE(fs::exists(path("disk/g.isb.partial")));
  // Still full.
  checkFailure(run(buildWords({"--out-dir", "disk", "--resume"})), 1, "disk/g.isb");
  disk.resize("size=32m");
  EXPECT_GT(runForJson(buildWords({"--out-dir", "disk", "--resume"}))["bricks_resumed"], 0);
  EXPECT_EQ(readBytes(path("disk/g.isb")), expected);
  // What cannot fit is refused before the work.
  fs::remove(path("disk/g.isb"));
  disk.resize("size=6m");
  expectFailure(1, buildWords({"--out-dir", "disk", "--codec", "none"}), "not enough space");
}

}  // namespace
}  // namespace isobrick
