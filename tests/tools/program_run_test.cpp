#include "tools/program_run.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <thread>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

ProgramCall shell(const std::string& script) { return {{"/bin/sh", "-c", script}, {}}; }

std::string failureOf(const ProgramCall& call) {
  try {
    runProgram(call);
  } catch (const Cancelled&) {
    return "cancelled";
  } catch (const Error& failure) {
    return failure.what();
  }
  return "no failure";
}

TEST(RunProgram, ReturnsWhatItPrints) {
  EXPECT_EQ(runProgram(shell("echo one; echo two")), "one\ntwo\n");
  EXPECT_EQ(runProgram(shell("exit 0")), "");
}

TEST(RunProgram, MoreThanAPipeHoldsOnBothSides) {
  const std::string out =
      runProgram(shell("head -c 3000000 /dev/zero >&2; head -c 3000000 /dev/zero; echo end"));
  EXPECT_EQ(out.size(), 3000004u);
}

TEST(RunProgram, HasNothingToReadFromItsStdin) { EXPECT_EQ(runProgram(shell("cat")), ""); }

TEST(RunProgram, SettingsComeBesideAndInPlaceOfOnesOwn) {
  setenv("ISOBRICK_TEST_KEPT", "kept", 1);
  setenv("ISOBRICK_TEST_CHANGED", "before", 1);
  ProgramCall call = shell("echo $ISOBRICK_TEST_KEPT $ISOBRICK_TEST_CHANGED");
  call.environment = {"ISOBRICK_TEST_CHANGED=after"};
  EXPECT_EQ(runProgram(call), "kept after\n");
}

TEST(RunProgram, AProgramThatFailsIsQuoted) {
  const std::string what =
      failureOf(shell("echo output; echo first >&2; echo the reason >&2; exit 3"));
  EXPECT_EQ(what, "'sh' left with status 3: the reason");
  EXPECT_EQ(failureOf(shell("echo sh: the reason >&2; exit 3")), what);
  EXPECT_EQ(failureOf(shell("exit 4")), "'sh' left with status 4: it does not say why");
}

TEST(RunProgram, AProgramThatIsKilledIsNamedWithItsSignal) {
  const std::string what = failureOf(shell("kill -KILL $$"));
  EXPECT_NE(what.find("'sh' was killed by signal 9 (Killed)"), std::string::npos) << what;
  EXPECT_NE(what.find("give less --memory"), std::string::npos) << what;  // no row of a benchmark
  EXPECT_NE(what.find("memory"), std::string::npos) << what;
  EXPECT_EQ(failureOf(shell("kill -SEGV $$")), "'sh' was killed by signal 11 (Segmentation fault)");
}

TEST(RunProgram, AProgramThatIsNotThere) {
  EXPECT_EQ(failureOf({{"/nowhere/at/all"}, {}}),
            "cannot run '/nowhere/at/all': No such file or directory");
}

TEST(RunProgram, ARequestToStopEndsTheProgram) {
  CancelFlag cancel;
  std::thread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    cancel.request();
  });
  // Would go on until the test's own time is over.
  EXPECT_THROW(runProgram({{"/bin/sleep", "100000"}, {}}, &cancel), Cancelled);
  later.join();
  EXPECT_THROW(runProgram(shell("true"), &cancel), Cancelled);
}

TEST(RunProgram, LinesOfItsStderrComeAsTheyAreWritten) {
  ProgramCall call = shell(
      "printf 'one\\ntwo' >&2; printf ' halves\\n' >&2; head -c 200000 /dev/zero | tr '\\0' x >&2; "
      "echo >&2; echo last >&2; exit 3");
  std::vector<std::string> lines;
  call.on_error_line = [&](std::string_view line) { lines.emplace_back(line); };
  try {
    runProgram(call);
    FAIL();
  } catch (const ProgramFailure& failure) {
    EXPECT_EQ(failure.said, "last");
  }
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_EQ(lines[0], "one");
  EXPECT_EQ(lines[1], "two halves");
  EXPECT_EQ(lines[2], std::string(200000, 'x'));
  EXPECT_EQ(lines[3], "last");
}

// A program that is cancelled may clean up, and one that does not end is killed.
TEST(RunProgram, ACancelledProgramEndsTidily) {
  const test::TemporaryFolder folder;
  for (const bool obeys : {true, false}) {
    const std::string begun = folder.file(obeys ? "begun" : "begun2");
    const std::string cleaned = folder.file(obeys ? "cleaned" : "cleaned2");
    ProgramCall call = shell(
        (obeys ? "trap 'touch " + cleaned + "; exit 130' TERM; " : std::string("trap '' TERM; ")) +
        "touch " + begun + "; while :; do sleep 0.02; done");
    call.tidy_end_milliseconds = obeys ? 60000 : 50;
    CancelFlag cancel;
    std::thread hand([&] {
      while (!std::filesystem::exists(begun)) std::this_thread::yield();
      cancel.request();
    });
    EXPECT_THROW(runProgram(call, &cancel), Cancelled);
    hand.join();
    EXPECT_EQ(std::filesystem::exists(cleaned), obeys);
  }
}

}  // namespace
}  // namespace isobrick
