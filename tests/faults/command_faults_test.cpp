// Commands in which a call to the system fails, whichever it is: one line on stderr and no file, or
// the same output as without.
#include <gtest/gtest.h>

#include <csignal>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>

#include "tests/faults/fault_sweep.h"
#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class CommandFaults : public CommandTest {
 protected:
  void SetUp() override { runWell({"build", "phantom:head:40", "--brick", "8", "-o", "head.isb"}); }
  // Gives up after a minute.
  Outcome runWithLimit(Words words) {
    const pid_t pid = start(std::move(words));
    int status = 0;
    for (int n = 0; n < 60000; ++n) {
      if (waitpid(pid, &status, WNOHANG) == pid)
        return {WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status),
                readBytes(log_.file("out")), readBytes(log_.file("err"))};
      const timespec millisecond = {0, 1000000};
      nanosleep(&millisecond, nullptr);
    }
    kill(pid, SIGKILL);
    waitpid(pid, &status, 0);
    return {-SIGALRM, "", "hangs"};
  }
  std::map<std::string, std::string> contents() const {
    std::map<std::string, std::string> all;
    for (const std::string& name : files())
      all[name] = fs::is_regular_file(path(name)) ? readBytes(path(name)) : "";
    return all;
  }
  void removeAllBut(const std::set<std::string>& kept) {
    for (const std::string& name : files())
      if (kept.count(name) == 0) fs::remove_all(path(name));
  }

  // `output`: what the command writes, or nothing.
  void sweep(const std::string& program, const Words& words, const std::string& output = "") {
    std::string line;
    for (const std::string& word : words) line += (line.empty() ? "" : " ") + word;
    SCOPED_TRACE(line);
    const std::set<std::string> before = files();
    const auto run = [&](const std::string& fault) {
      Words all = words;
      all.insert(all.begin(), {program, fault});
      return runWithLimit(std::move(all));
    };
    const Outcome good = run("count:" + log_.file("counts"));
    ASSERT_EQ(good.status, 0) << good.err;
    const std::map<std::string, std::string> expected = contents();
    ASSERT_TRUE(output.empty() || fs::exists(path(output)));
    std::map<std::string, std::uint64_t> counts;
    std::ifstream in(log_.file("counts"));
    for (std::string kind; in >> kind;) in >> counts[kind];
    ASSERT_EQ(counts.size(), std::size(kFaultKinds));
    for (const FaultKind kind : kFaultKinds) {
      const std::vector<std::uint64_t> numbers = faultNumbers(counts[nameOf(kind)], 24);
      int failures = 0, wrong = 0;
      for (const std::uint64_t number : numbers) {
        removeAllBut(before);
        const Outcome outcome = run(nameOf(kind) + (":" + std::to_string(number)));
        std::string what;
        if (outcome.status == 0) {
          if (contents() != expected) what = "leaves other files than without the fault";
        } else if (outcome.status != 1) {
          what = "ends with " + std::to_string(outcome.status);
        } else {
          ++failures;
          if (outcome.errorLines() != 1 || outcome.err.rfind("isobrick: ", 0) != 0)
            what = "does not say what went wrong in one line";
          else if (files() != before && contents() != expected)
            what = "leaves a file that is not whole";
        }
        if (what.empty()) continue;
        ++wrong;
        ADD_FAILURE() << line << ": " << nameOf(kind) << ":" << number << " " << what << "\n"
                      << outcome.err;
      }
      std::printf("%s: %s: %llu calls, %zu tried, %d errors, %d wrong\n", line.c_str(),
                  nameOf(kind), static_cast<unsigned long long>(counts[nameOf(kind)]),
                  numbers.size(), failures, wrong);
    }
    removeAllBut(before);
  }
  void sweepExtract(const Words& words, const std::string& output = "") {
    sweep(isobrickExtractWithFaults(), words, output);
  }
  void sweepConvert(const std::string& output) {
    sweep(isobrickWithFaults(), {"convert", "head.isb", "-o", output, "--threads", "1"}, output);
  }
};

TEST_F(CommandFaults, Extract) {
  sweepExtract({"extract", "head.isb", "--iso", "500", "-o", "mesh.ply", "--threads", "1"},
               "mesh.ply");
  sweepExtract(
      {"extract", "head.isb", "--iso", "500", "--focus", "20,18,15", "--radius", "6", "--json"});
}
TEST_F(CommandFaults, ExtractForNeuroglancer) {
  sweepExtract({"extract", "head.isb", "--iso", "500", "-o", "m.precomputed", "--threads", "1"},
               "m.precomputed");
}
TEST_F(CommandFaults, InfoAndVerify) {
  sweepExtract({"info", "head.isb", "--json"});
  sweepExtract({"verify", "head.isb", "--threads", "1"});
}
TEST_F(CommandFaults, Render) {
  sweepExtract({"render", "head.isb", "--iso", "500", "--size", "64x48", "-o", "head.png"},
               "head.png");
}
TEST_F(CommandFaults, Convert) {
  for (const char* output : {"head.nrrd", "head.vti", "head.nii.gz", "head.ome.zarr"})
    sweepConvert(output);
}

}  // namespace
}  // namespace isobrick::test
