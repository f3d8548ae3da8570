// Commands in which a call to the system fails, whichever it is: one line on stderr and no file, or
// the same output as without.
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>

#include "tests/faults/fault_sweep.h"
#include "tests/support/command_test.h"
#include "tests/support/requirement.h"

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
  using Contents = std::map<std::string, std::string>;
  Contents contents() const {
    Contents all;
    for (const std::string& name : files()) {
      std::string bytes = fs::is_regular_file(path(name)) ? readBytes(path(name)) : "";
      // Behind its versions a VDB has a number that is another one each time it is written.
      if (name.ends_with(".vdb") && bytes.size() > 57) bytes.replace(21, 36, 36, '-');
      all[name] = std::move(bytes);
    }
    return all;
  }
  void removeAllBut(const std::set<std::string>& kept) {
    for (const std::string& name : files())
      if (kept.count(name) == 0) fs::remove_all(path(name));
  }

  // What a sweep of one command expects.
  struct Swept {
    std::string program;
    Words words;
    std::string output = "";  // what the command writes, or nothing
    // What a failed run may leave: the unfinished pyramid, or whole files of its output's folder.
    bool may_leave_parts = false;
    Words again = {};                   // makes the whole of what is left; default: the same words
    std::set<std::string> may_go = {};  // of what was there
    bool has_many_lines = false;        // one for each damage
    bool has_known_input = false;       // another sweep reads the same: by day a few of its calls
  };
  // Of files that belong together, some are the old ones and others the new ones.
  static bool isMixed(const std::set<std::string>& names, const Contents& left,
                      const Contents& old_ones, const Contents& new_ones) {
    const auto hasOneOf = [&](const Contents& ones, const Contents& others) {
      return std::any_of(names.begin(), names.end(), [&](const std::string& name) {
        const auto is = left.find(name), one = ones.find(name), other = others.find(name);
        return is != left.end() && one != ones.end() && is->second == one->second &&
               (other == others.end() || is->second != other->second);
      });
    };
    return hasOneOf(old_ones, new_ones) && hasOneOf(new_ones, old_ones);
  }
  // How many of so many calls fail, and which: at night all, or a thousand spread over all.
  static std::vector<std::uint64_t> numbersOf(std::uint64_t count, bool for_good, bool are_few) {
    if (environmentSays("ISOBRICK_ALL_FAULTS")) return faultNumbers(count, 1000);
    const std::uint64_t usual = are_few ? 3 : 6;
    return faultNumbers(count, for_good ? usual / 2 : usual);
  }

  void sweep(const Swept& swept) {
    std::string line;
    for (const std::string& word : swept.words) line += (line.empty() ? "" : " ") + word;
    SCOPED_TRACE(line);
    const std::set<std::string> before = files();
    const Contents at_first = contents();
    const auto run = [&](const std::string& fault, const Words& words) {
      Words all = words;
      all.insert(all.begin(), {swept.program, fault});
      return runWithLimit(std::move(all));
    };
    const auto begin = [&] {
      removeAllBut(before);
      for (const std::string& name : swept.may_go) writeBytes(path(name), at_first.at(name));
    };
    const Outcome good = run("count:" + log_.file("counts"), swept.words);
    ASSERT_EQ(good.status, 0) << good.err;
    const Contents expected = contents();
    ASSERT_TRUE(swept.output.empty() || fs::exists(path(swept.output)));
    std::map<std::string, std::uint64_t> counts;
    std::ifstream in(log_.file("counts"));
    for (std::string kind; in >> kind;) in >> counts[kind];
    ASSERT_EQ(counts.size(), std::size(kFaultKinds));
    const bool is_folder = !swept.output.empty() && fs::is_directory(path(swept.output));
    for (const FaultKind kind : kFaultKinds)
      for (const bool for_good : {false, true}) {
        // To empty a folder takes memory.
        const bool may_leave_parts =
            swept.may_leave_parts || (is_folder && for_good && kind == FaultKind::kAllocation);
        const auto isAllowed = [&](const std::string& name, const std::string& bytes) {
          const auto whole = expected.find(name);
          return (before.count(name) != 0 && bytes == at_first.at(name)) ||
                 (whole != expected.end() && bytes == whole->second) ||
                 (may_leave_parts && name.find(".partial") != std::string::npos);
        };
        const std::vector<std::uint64_t> numbers = numbersOf(
            counts[nameOf(kind)], for_good, swept.has_known_input && kind != FaultKind::kWrite);
        int failures = 0, wrong = 0;
        for (const std::uint64_t number : numbers) {
          begin();
          const std::string fault =
              nameOf(kind) + (":" + std::to_string(number)) + (for_good ? "+" : "");
          const Outcome outcome = run(fault, swept.words);
          const Contents left = contents();
          std::string what;
          if (outcome.status == 0) {
            if (left != expected) what = "leaves other files than without the fault";
          } else if (outcome.status != 1) {
            what = "ends with " + std::to_string(outcome.status);
          } else {
            ++failures;
            if ((outcome.errorLines() != 1 && !swept.has_many_lines) ||
                outcome.err.rfind("isobrick: ", 0) != 0)
              what = "does not say what went wrong in one line";
            if (!may_leave_parts && files() != before && left != expected && swept.may_go.empty())
              what = "leaves a file that is not whole";
            for (const auto& [name, bytes] : left)
              if (!isAllowed(name, bytes)) what = "leaves '" + name + "'";
            if (isMixed(swept.may_go, left, at_first, expected))
              what = "leaves old files together with new ones";
            // What is left is in nobody's way.
            if (what.empty() && files() != before && left != expected &&
                (run("none", swept.again.empty() ? swept.words : swept.again).status != 0 ||
                 contents() != expected))
              what = "leaves what makes the next run another one";
          }
          if (what.empty()) continue;
          ++wrong;
          ADD_FAILURE() << line << ": " << fault << " " << what << "\n" << outcome.err;
        }
        std::printf("%s: %s%s: %llu calls, %zu tried, %d errors, %d wrong\n", line.c_str(),
                    nameOf(kind), for_good ? " for good" : "",
                    static_cast<unsigned long long>(counts[nameOf(kind)]), numbers.size(), failures,
                    wrong);
      }
    begin();
  }
  void sweepExtract(const Words& words, const std::string& output = "") {
    sweep({isobrickExtractWithFaults(), words, output});
  }
  void sweepConvert(const std::string& output, bool is_first = false, Words more = {}) {
    Swept swept{isobrickWithFaults(),
                {"convert", "head.isb", "-o", output, "--threads", "1"},
                output.substr(0, output.find('/'))};
    swept.has_known_input = !is_first;
    if (!more.empty()) swept.may_go = {"head.mhd", "head.raw"};
    swept.words.insert(swept.words.end(), more.begin(), more.end());
    sweep(swept);
  }
};

TEST_F(CommandFaults, Build) {
  runWell({"phantom", "head", "--voxels", "40", "-o", "head.nrrd"});
  const Words words = {"build", "head.nrrd", "--brick", "8", "-o", "new.isb", "--threads", "1"};
  Words again = words;
  again.push_back("--resume");
  sweep({isobrickWithFaults(), words, "new.isb", true, again});
}
TEST_F(CommandFaults, BuildOfManyFiles) {
  runWell({"phantom", "head", "--voxels", "24", "-o", "head.nrrd"});
  const Words words = {"build", "head.nrrd", "--brick",  "8",         "--super-brick",
                       "16",    "-o",        "new.isbs", "--threads", "1"};
  Words again = words;
  again.push_back("--resume");
  sweep({isobrickWithFaults(), words, "new.isbs", true, again});
}
TEST_F(CommandFaults, Extract) {
  sweepExtract({"extract", "head.isb", "--iso", "500", "-o", "mesh.ply", "--threads", "1"},
               "mesh.ply");
  sweepExtract(
      {"extract", "head.isb", "--iso", "500", "--focus", "20,18,15", "--radius", "6", "--json"});
}
TEST_F(CommandFaults, ExtractOfAVolume) {
  runWell({"phantom", "head", "--voxels", "40", "-o", "head.nrrd"});
  sweep({isobrickWithFaults(),
         {"extract", "head.nrrd", "--iso", "500", "-o", "mesh.ply", "--threads", "1"},
         "mesh.ply"});
}
TEST_F(CommandFaults, ExtractForNeuroglancer) {
  sweepExtract({"extract", "head.isb", "--iso", "500", "-o", "m.precomputed", "--threads", "1"},
               "m.precomputed");
}
TEST_F(CommandFaults, SharesAndMerge) {
  const Words share = {"extract", "head.isb", "--iso", "500", "--threads", "1", "--part"};
  for (const std::string number : {"1", "2"}) {
    Words words = share;
    words.insert(words.end(), {number + "/2", "-o", number + ".isbm"});
    if (number == "2") sweepExtract(words, "2.isbm");
    runWell(words);
  }
  sweepExtract({"merge", "1.isbm", "2.isbm", "-o", "mesh.ply", "--threads", "1"}, "mesh.ply");
}
TEST_F(CommandFaults, InfoAndVerify) {
  sweepExtract({"info", "head.isb", "--json"});
  Swept verifying{isobrickExtractWithFaults(), {"verify", "head.isb", "--threads", "1"}};
  verifying.has_many_lines = true;
  sweep(verifying);
}
TEST_F(CommandFaults, Cache) {
  const std::string name = "cache/0123456789abcdef.isb";
  fs::create_directory(path("cache"));
  fs::copy_file(path("head.isb"), path(name));
  sweepExtract({"cache", "--cache-folder", "cache", "--json"});
  Swept clearing{isobrickExtractWithFaults(), {"cache", "--cache-folder", "cache", "--clear"}};
  clearing.may_go = {name};
  sweep(clearing);
}
TEST_F(CommandFaults, Render) {
  sweepExtract({"render", "head.isb", "--iso", "500", "--size", "64x48", "-o", "head.png"},
               "head.png");
}
TEST_F(CommandFaults, ViewOffscreen) {
  writeBytes(
      path("script.json"),
      R"({"size": [64, 48], "steps": [{"wait": "settled"}, {"picture": "p.png"}, {"mesh": "m.ply"}]})");
  sweep(
      {isobrickViewWithFaults(),
       {"view", "head.isb", "--offscreen", "--script", "script.json", "--threads", "1", "--force"},
       "m.ply",
       true});
}
TEST_F(CommandFaults, Convert) {
  sweepConvert("head.nrrd", true);
  for (const char* output : {"head.vti", "head.nii.gz", "head.ome.zarr", "head.tif",
                             "slices/%02d.tif", "head.mhd", "head.h5", "head.vdb"})
    sweepConvert(output);
  // A pair in place of another one.
  runWell({"convert", "head.isb", "--level", "1", "-o", "head.mhd"});
  sweepConvert("head.mhd", false, {"--force"});
}

}  // namespace
}  // namespace isobrick::test
