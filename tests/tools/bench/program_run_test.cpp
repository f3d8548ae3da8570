#include "tools/bench/program_run.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

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

}  // namespace
}  // namespace isobrick
