// Losses of power at every moment of what writes files: each name is absent or has what it had
// before, or it is whole, and the same command again makes all of it.
#include "tests/faults/power_loss.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "tests/support/command_test.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {
namespace {

// Of each model, over all moments; no moment has fewer than kLeastEach.
constexpr int kStates = 6000;
constexpr std::uint64_t kLeastEach = 8;

// The names that a run makes or replaces as a whole.
enum class Units { kOutputs, kFilesOfAFolder };

unsigned long long longOf(std::uint64_t number) { return number; }

class PowerLossTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "24", "--type", "u8", "-o", "g.nrrd"});
  }
  void makePyramid() { runWell({"build", "g.nrrd", "--brick", "8", "-o", "g.isb"}); }

  FolderContent contents() const {
    FolderContent all;
    for (const std::string& name : files())
      if (fs::is_directory(path(name)))
        all[name + "/"] = "";
      else
        all[name] = readBytes(path(name));
    return all;
  }
  void restore(const FolderContent& content) {
    for (const auto& entry : fs::directory_iterator(work_.path()))
      if (content.count(entry.path().filename()) == 0) fs::remove_all(entry.path());
    for (const auto& [name, bytes] : content)
      if (name.back() == '/') fs::create_directories(path(name));
      // An input that is written anew is another one.
      else if (!fs::exists(path(name)) || readBytes(path(name)) != bytes)
        writeBytes(path(name), bytes);
  }

  static bool isHeader(const std::string& name) { return name.ends_with(".mhd"); }

  // All of one output: a file, or a folder with what is in it; a header with its voxels.
  static FolderContent unitOf(const FolderContent& content, const std::string& unit) {
    FolderContent part;
    for (auto entry = content.lower_bound(unit); entry != content.end(); ++entry) {
      if (entry->first.compare(0, unit.size(), unit) != 0) break;
      if (entry->first.size() == unit.size() || entry->first[unit.size()] == '/' ||
          unit.back() == '/')
        part.insert(*entry);
    }
    if (isHeader(unit))
      if (const auto voxels = content.find(unit.substr(0, unit.size() - 4) + ".raw");
          voxels != content.end())
        part.insert(*voxels);
    return part;
  }

  // A loss at each moment of the run of `words`, by isobrick_with_faults or its like. `units`: the
  // outputs, or a folder each file of which is one. `again` follows each loss (and gives what a run
  // without one gives), in so many of the states.
  void lose(const std::string& program, const Words& words, const std::string& output,
            const Words& again, int most_again, Units units = Units::kOutputs) {
    std::string line;
    for (const std::string& word : words) line += (line.empty() ? "" : " ") + word;
    SCOPED_TRACE(line);
    most_again = most_again == 0 ? 0 : repetitions(most_again);
    const bool has_own_number = output.ends_with(".vdb");
    Words recorded = words;
    recorded.insert(recorded.begin(), {program, "record:" + log_.file("changes")});
    const Outcome good = wait(start(std::move(recorded)));
    ASSERT_EQ(good.status, 0) << good.err;
    const PowerLoss loss(readChanges(log_.file("changes")));
    const FolderContent before = loss.before(), after = loss.after();
    ASSERT_TRUE(after == contents()) << "a change was not recorded";
    std::vector<std::string> names = {output};
    if (units == Units::kFilesOfAFolder) {
      names.clear();
      for (const auto& [name, bytes] : after)
        if (name.rfind(output + "/", 0) == 0 && name.back() != '/') names.push_back(name);
    }
    ASSERT_FALSE(names.empty());

    std::map<std::string, int> wrong;
    std::vector<FolderContent> sample;
    for (const DiskModel model : {DiskModel::kOrdered, DiskModel::kWeak}) {
      std::uint64_t number = 0;
      std::uint64_t every = 1;
      std::vector<FolderContent> chosen;
      const LossCounts counts = loss.visitStates(
          model,
          std::max(kLeastEach,
                   static_cast<std::uint64_t>(repetitions(kStates)) / (1 + loss.changes())),
          [&](const FolderContent& state, bool is_done) {
            for (const auto& [name, bytes] : state) judgeName(name, output, before, after, wrong);
            for (const std::string& name : names) {
              const FolderContent is = unitOf(state, name);
              if (is == unitOf(after, name)) continue;
              if (is_done) ++wrong["'" + name + "' is lost after the end"];
              // Without its header a pair is no volume.
              else if (is != unitOf(before, name) && !(isHeader(name) && is.count(name) == 0))
                ++wrong["'" + name + "' is not whole"];
            }
            // Of all of them, evenly.
            if (most_again == 0 || number++ % every != 0) return;
            chosen.push_back(state);
            if (chosen.size() < 2 * static_cast<std::size_t>(most_again)) return;
            every *= 2;
            for (std::size_t i = 1; 2 * i < chosen.size(); ++i) chosen[i] = chosen[2 * i];
            chosen.resize(chosen.size() / 2);
          });
      std::printf("%s: %s: %zu changes, %llu moments (%llu in full), %llu states, %llu distinct\n",
                  line.c_str(), model == DiskModel::kOrdered ? "ordered" : "weak", loss.changes(),
                  longOf(counts.moments), longOf(counts.complete), longOf(counts.states),
                  longOf(counts.distinct));
      sample.insert(sample.end(), chosen.begin(), chosen.end());
    }
    for (const auto& [what, count] : wrong) ADD_FAILURE() << count << " states: " << what;

    // Each VDB has a number of its own; then the length tells.
    const auto same = [&](const FolderContent& is, const FolderContent& other) {
      return std::equal(is.begin(), is.end(), other.begin(), other.end(),
                        [&](const auto& a, const auto& b) {
                          return a.first == b.first && a.second.size() == b.second.size() &&
                                 (has_own_number || a.second == b.second);
                        });
    };
    int resumed = 0, anew = 0;
    for (const FolderContent& state : sample) {
      restore(state);
      const Outcome outcome = run(again);
      ASSERT_EQ(outcome.status, 0) << outcome.err << namesOf(state);
      const FolderContent is = contents();
      for (const std::string& name : names)
        EXPECT_TRUE(same(unitOf(is, name), unitOf(after, name)))
            << name << " of " << namesOf(state);
      const bool has_begun = state.count(output + ".partial") != 0;
      const bool says_resumed = outcome.out.find("resumed: ") != std::string::npos;
      const bool says_anew = outcome.out.find("no brick of the earlier run") != std::string::npos;
      resumed += says_resumed ? 1 : 0;
      anew += says_anew ? 1 : 0;
      const bool is_resume = again.back() == "--resume";
      EXPECT_TRUE(!is_resume || !has_begun || says_resumed || says_anew ||
                  outcome.out.find("up to date") != std::string::npos)
          << outcome.out << namesOf(state);
      for (const auto& [name, bytes] : is)
        EXPECT_TRUE(name.find(".partial") == std::string::npos || isNameless(name))
            << name << " is left by " << line;
    }
    std::printf("%s: again in %zu states, %d resumed, %d anew\n", line.c_str(), sample.size(),
                resumed, anew);
    restore(after);
  }

 private:
  static std::string namesOf(const FolderContent& state) {
    std::string names = "the state of";
    for (const auto& [name, bytes] : state)
      names += " " + name + " (" + std::to_string(bytes.size()) + ")";
    return names;
  }
  // A file whose name goes at once (extract/sinks/side_file.h) may keep it if the power goes then.
  static bool isNameless(const std::string& name) {
    const std::size_t dot = name.rfind('.');
    return dot != std::string::npos && name.size() - dot == 7 && name.substr(dot) != ".partial";
  }
  // Beside outputs and inputs there are temporary files, whose names say so.
  static void judgeName(const std::string& name, const std::string& output,
                        const FolderContent& before, const FolderContent& after,
                        std::map<std::string, int>& wrong) {
    if (before.count(name) != 0 || after.count(name) != 0) return;
    if (name.rfind(output, 0) == 0 || name.find(".partial") != std::string::npos ||
        name.find(".isobrick-scratch-") != std::string::npos)
      return;
    ++wrong["'" + name + "' is there"];
  }
};

TEST_F(PowerLossTest, ABuild) {
  const Words words = {"build", "g.nrrd",    "--brick", "8",        "--memory",
                       "8M",    "--threads", "1",       "--output", "g.isb"};
  Words again = words;
  again.push_back("--resume");
  lose(isobrickWithFaults(), words, "g.isb", again, 30);
  runWell({"verify", "g.isb"});
  // In place of another one.
  runWell({"build", "g.nrrd", "--brick", "16", "-o", "g.isb", "--rebuild"});
  Words anew = words;
  anew.push_back("--rebuild");
  lose(isobrickWithFaults(), anew, "g.isb", words, 8);
}

TEST_F(PowerLossTest, ABuildThatIsResumed) {
  const Words words = {"build",     "g.nrrd", "--brick",  "8",     "--memory", "8M",
                       "--threads", "1",      "--output", "g.isb", "--resume"};
  Words killed = words;
  killed.insert(killed.begin(), {isobrickWithFaults(), "signal:9:40"});
  ASSERT_EQ(wait(start(killed)).status, -SIGKILL);
  lose(isobrickWithFaults(), words, "g.isb", words, 30);
  runWell({"verify", "g.isb"});
}

TEST_F(PowerLossTest, APyramidOfManyFiles) {
  const Words words = {"build", "g.nrrd",    "--brick", "8",  "--super-brick",
                       "16",    "--threads", "1",       "-o", "g.isbs"};
  for (const char* part : {"1/2", "2/2"}) {
    Words share = words;
    share.insert(share.end(), {"--part", part});
    Words again = share;
    again.push_back("--resume");
    lose(isobrickWithFaults(), share, "g.isbs", again, 5, Units::kFilesOfAFolder);
  }
  lose(isobrickWithFaults(), {"build", "g.isbs", "--join"}, "g.isbs", {"merge", "g.isbs"}, 5,
       Units::kFilesOfAFolder);
  runWell({"verify", "g.isbs"});
}

TEST_F(PowerLossTest, Conversions) {
  makePyramid();
  for (const std::string output : {"a.nrrd", "a.mhd", "a.nii.gz", "a.vti", "a.tif", "a.h5", "a.vdb",
                                   "a.ome.zarr", "slices/%02d.tif", "pages/%02d.exr", "a.isb"}) {
    const Words words = {"convert", "g.isb", "-o", output, "--threads", "1", "--force"};
    const std::string name = output.substr(0, output.find('/'));
    lose(isobrickWithFaults(), words, name, words, 2);
  }
  // In place of others.
  for (const std::string output : {"a.nrrd", "a.mhd", "a.ome.zarr"}) {
    const Words words = {"convert", "g.isb", "-o", output, "--level", "1", "--force"};
    lose(isobrickWithFaults(), words, output, words, 2);
  }
}

TEST_F(PowerLossTest, AConversionInParts) {
  makePyramid();
  const Words words = {"convert", "g.isb",     "-o", "b.ome.zarr", "--zarr-shard",
                       "64",      "--threads", "1",  "--force",    "--part"};
  Words first = words, second = words;
  first.push_back("1/2");
  second.push_back("2/2");
  lose(isobrickWithFaults(), first, "b.ome.zarr.part-1-of-2", first, 2);
  // A loss may take the first part, too, whose share is then made again.
  lose(isobrickWithFaults(), second, "b.ome.zarr", second, 0);
}

TEST_F(PowerLossTest, Meshes) {
  makePyramid();
  for (const std::string output :
       {"m.ply", "m.stl", "m.obj", "m.glb", "m.vtp", "m.3mf", "m.isbm", "m.precomputed"}) {
    const Words words = {"extract", "g.isb",     "--iso", "100",    "-o",
                         output,    "--threads", "1",     "--force"};
    lose(isobrickExtractWithFaults(), words, output, words, 2);
  }
  const Words together = {"extract", "g.isb",   "--iso",     "60", "--iso",      "100",
                          "-o",      "two.glb", "--threads", "1",  "--together", "--force"};
  lose(isobrickExtractWithFaults(), together, "two.glb", together, 2);
  const Words other = {"extract", "g.isb",     "--iso", "60",     "-o",
                       "m.ply",   "--threads", "1",     "--force"};
  lose(isobrickExtractWithFaults(), other, "m.ply", other, 2);
  const Words merge = {"merge", "m.isbm", "-o", "merged.ply", "--force"};
  lose(isobrickExtractWithFaults(), merge, "merged.ply", merge, 2);
}

}  // namespace
}  // namespace isobrick::test
