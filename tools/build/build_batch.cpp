#include "tools/build/build_batch.h"

#include <fmt/format.h>
#include <glob.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <new>
#include <optional>
#include <string>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/remote_options.h"
#include "tools/build/build_report.h"
#include "tools/command.h"
#include "tools/failure_text.h"
#include "tools/interrupt.h"
#include "tools/outputs.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"

namespace isobrick {
namespace {

// The outcome of one job: a pyramid, or a reason why not.
struct BatchEntry {
  const BuildJob* job = nullptr;
  std::optional<BuiltVolume> built;
  std::string reason;
  bool interrupted = false;

  std::string state() const {
    if (built) return built->skipped ? "up to date" : "built";
    return interrupted ? "interrupted" : "FAILED";
  }
};

class BuildBatch {
 public:
  BuildBatch(const std::vector<BuildJob>& jobs, const BuildSettings& settings, bool json)
      : jobs_(jobs), settings_(settings), json_(json) {}

  int run() {
    for (const BuildJob& job : jobs_) {
      const BatchEntry& entry = buildNext(job);
      if (entry.interrupted) break;
      if (!json_) printLine(entry);
      if (!entry.built) fmt::print(stderr, "isobrick: {}\n", oneLine(withInput(entry)));
    }
    if (json_)
      printJson(jsonOfAll());
    else
      printTable();
    const BatchEntry& last = entries_.back();
    if (last.interrupted) throw Cancelled(withInput(last) + "; " + countsText());
    return count("FAILED") > 0 ? 1 : 0;
  }

 private:
  const BatchEntry& buildNext(const BuildJob& job) {
    BatchEntry entry;
    entry.job = &job;
    try {
      interruptFlag().check();
      entry.built = buildOne(labelled(job), settings_);
    } catch (const Cancelled& cancelled) {
      entry.reason = failureText(cancelled, optionsOf(*job.input.parser));
      entry.interrupted = true;
    } catch (const std::exception& failure) {
      entry.reason = failureText(failure, optionsOf(*job.input.parser));
    }
    return entries_.emplace_back(std::move(entry));
  }

  // "[3/8] tooth.nhdr  "
  BuildJob labelled(const BuildJob& job) const {
    BuildJob with = job;
    const std::filesystem::path input(job.input.path);
    const std::string name = input.has_filename() ? input.filename().string() : input.string();
    with.label = fmt::format("[{}/{}] {}  ", entries_.size() + 1, jobs_.size(), oneLine(name));
    return with;
  }

  // Most reasons name the input themselves.
  static std::string withInput(const BatchEntry& entry) {
    const std::string& input = entry.job->input.path;
    if (entry.reason.find("'" + input + "'") != std::string::npos) return entry.reason;
    return fmt::format("'{}': {}", input, entry.reason);
  }

  void printLine(const BatchEntry& entry) const {
    if (entry.built)
      fmt::print("{}\n", builtLine(*entry.built));
    else
      fmt::print("{}: FAILED: {}\n", oneLine(entry.job->input.path), oneLine(entry.reason));
    std::fflush(stdout);  // readers of a pipe see the progress at once; main checks for errors
  }

  std::size_t count(const std::string& state) const {
    return static_cast<std::size_t>(
        std::count_if(entries_.begin(), entries_.end(),
                      [&](const BatchEntry& entry) { return entry.state() == state; }));
  }

  std::string countsText() const {
    const std::size_t done = count("built") + count("up to date") + count("FAILED");
    std::string text = fmt::format("of {} volumes {} built, {} up to date, {} failed", jobs_.size(),
                                   count("built"), count("up to date"), count("FAILED"));
    if (done < jobs_.size()) text += fmt::format(", {} not done", jobs_.size() - done);
    return text;
  }

  void printTable() const {
    TextTable table("LLRLRRRRRL");
    table.add(
        {"input", "output", "voxels", "type", "raw", "file", "ratio", "seconds", "MB/s", "state"});
    BuiltVolume total;
    for (const BatchEntry& entry : entries_) {
      const std::string input = oneLine(entry.job->input.path);
      if (!entry.built) {
        table.add({input, "-", "-", "-", "-", "-", "-", "-", "-", entry.state()});
        continue;
      }
      const BuiltVolume& built = *entry.built;
      const Index3& voxels = built.volume.voxels;
      std::vector<std::string> row = {input, oneLine(built.output),
                                      fmt::format("{}x{}x{}", voxels.x, voxels.y, voxels.z),
                                      std::string(voxelTypeName(built.volume.voxel_type))};
      appendFigures(row, built, !built.skipped);
      row.push_back(entry.state());
      table.add(std::move(row));
      total.bytes.raw += built.bytes.raw;
      total.bytes.total += built.bytes.total;
      total.fresh_bytes += built.fresh_bytes;
    }
    total.seconds = watch_.seconds();
    std::vector<std::string> row = {"total", "", "", ""};
    appendFigures(row, total, true);
    row.push_back("");
    table.add(std::move(row));
    fmt::print("\n{}{} in {:.2f} s; {} threads; peak memory {}\n", table.text(), countsText(),
               total.seconds, settings_.threads, byteSizeText(peakResidentBytes()));
  }

  static void appendFigures(std::vector<std::string>& row, const BuiltVolume& of, bool was_built) {
    const double rate = of.megabytesPerSecond(of.seconds);
    const auto raw = static_cast<double>(of.bytes.raw);
    row.push_back(raw > 0 ? byteSizeText(of.bytes.raw) : "-");
    row.push_back(raw > 0 ? byteSizeText(of.bytes.total) : "-");
    row.push_back(raw > 0 ? fmt::format("{:.2f}", static_cast<double>(of.bytes.total) / raw) : "-");
    row.push_back(was_built ? fmt::format("{:.2f}", of.seconds) : "-");
    row.push_back(rate > 0 ? fmt::format("{:.0f}", rate) : "-");
  }

  Json jsonOfAll() const {
    Json json = Json::object();
    json["volumes"] = Json::array();
    for (const BatchEntry& entry : entries_)
      json["volumes"].push_back(
          entry.built ? jsonOfBuilt(*entry.job, *entry.built, settings_)
                      : Json{{"input", entry.job->input.path}, {"error", oneLine(entry.reason)}});
    json["seconds"] = watch_.seconds();
    json["built"] = count("built");
    json["skipped"] = count("up to date");
    json["failed"] = count("FAILED");
    json["interrupted"] = entries_.back().interrupted;
    return json;
  }

  const std::vector<BuildJob>& jobs_;
  const BuildSettings& settings_;
  const bool json_;
  const Stopwatch watch_;
  std::vector<BatchEntry> entries_;
};

}  // namespace

int runBuildBatch(const std::vector<BuildJob>& jobs, const BuildSettings& settings, bool json) {
  return BuildBatch(jobs, settings, json).run();
}

namespace {

class GlobMatches {
 public:
  explicit GlobMatches(const std::string& pattern)
      : status_(glob(pattern.c_str(), 0, nullptr, &matches_)) {}
  ~GlobMatches() { globfree(&matches_); }
  GlobMatches(const GlobMatches&) = delete;
  GlobMatches& operator=(const GlobMatches&) = delete;

  std::vector<std::string> paths() const {
    if (status_ == GLOB_NOSPACE) throw std::bad_alloc();
    if (status_ != 0) return {};
    return {matches_.gl_pathv, matches_.gl_pathv + matches_.gl_pathc};
  }

 private:
  glob_t matches_ = {};
  int status_;
};

}  // namespace

std::vector<std::pair<std::int64_t, std::string>> filesOfSequence(const std::string& word) {
  std::vector<std::pair<std::int64_t, std::string>> files;
  const auto name = parseNumberedName(word);
  if (!name || isRemotePath(word) || isNameTaken(word)) return files;
  for (const std::string& path : GlobMatches(name->before + "*" + name->after).paths()) {
    if (!name->matches(path)) continue;
    const std::size_t digits = path.size() - name->before.size() - name->after.size();
    if (const auto number = numberIn<std::int64_t>(path.substr(name->before.size(), digits)))
      files.emplace_back(*number, path);
  }
  return files;
}

bool isInputPattern(const std::string& word) {
  return (word.find_first_of("*?[") != std::string::npos || parseNumberedName(word)) &&
         !isRemotePath(word) && !isNameTaken(word);
}

std::vector<std::string> expandInputs(const std::vector<std::string>& words) {
  std::vector<std::string> inputs;
  for (const std::string& word : words) {
    if (!isInputPattern(word)) {
      inputs.push_back(word);
      continue;
    }
    std::vector<std::string> matches;
    for (const auto& [number, path] : filesOfSequence(word)) matches.push_back(path);
    if (matches.empty()) matches = GlobMatches(word).paths();
    if (matches.empty())
      throw Error(
          fmt::format("nothing matches the input '{}'; check the folder and the pattern", word));
    inputs.insert(inputs.end(), matches.begin(), matches.end());
  }
  return inputs;
}

namespace {

// Those of channels are their names, as far as they tell them apart, and otherwise their numbers.
std::vector<std::string> namesOfChannels(const VolumeInfo& info) {
  std::vector<std::string> names;
  for (std::int64_t number = 0; number < info.channel.count; ++number) {
    const auto place = static_cast<std::size_t>(number);
    const std::string name =
        place < info.named_channels.size() ? info.named_channels[place].name : std::string();
    names.push_back(name.empty() ? fmt::format("{}", number) : name);
  }
  const std::vector<std::string> all = names;
  for (std::size_t i = 0; i < names.size(); ++i)
    if (std::ranges::count(all, names[i]) > 1) names[i] += fmt::format("-{}", i);
  return names;
}

std::vector<std::string> namesOfTimes(std::int64_t count) {
  const std::size_t digits = fmt::format("{}", count - 1).size();
  std::vector<std::string> names;
  for (std::int64_t number = 0; number < count; ++number)
    names.push_back(fmt::format("{:0{}}", number, digits));
  return names;
}

std::string outputOf(const std::string& pattern, std::string_view key, const std::string& name) {
  return hasPlace(pattern, key) ? withPlaceFilled(pattern, key, name) : nameWith(pattern, name);
}

// Of those with gaps between their numbers nobody knows the next one, and hostile files count what
// they like.
void refuseUncounted(const BuildJob& job, const char* kind, std::int64_t count) {
  constexpr std::int64_t kMost = 1'000'000;
  if (count < 1 || count > kMost)
    throw Error(
        fmt::format(
            "the {0}s of '{1}' {2}; choose one with --select {0}=N", kind, job.input.path,
            count < 1 ? std::string("have numbers with gaps")
                      : fmt::format("are {}, and at most {} are built in one call", count, kMost)),
        {.path = job.input.path});
}

}  // namespace

std::vector<BuildJob> jobsOfMembers(const BuildJob& job, const BuildSettings& settings) {
  const bool all_times = job.input.all_times, all_channels = job.input.all_channels;
  if (!all_times && !all_channels) return {job};
  BuildJob first = job;
  first.input.all_times = first.input.all_channels = false;
  if (all_times) first.input.time = 0;
  if (all_channels) first.input.channel = 0;
  refuseKnownMisfits(first.input);
  const VolumeInfo info =
      openShowingProgress(first.input, settings.options.memory_bytes / 2)->info();
  if (all_times) refuseUncounted(job, "time", info.time_step.count);
  if (all_channels) refuseUncounted(job, "channel", info.channel.count);
  std::vector<BuildJob> jobs;
  const std::vector<std::string> times = namesOfTimes(all_times ? info.time_step.count : 1);
  const std::vector<std::string> channels =
      all_channels ? namesOfChannels(info) : std::vector<std::string>(1);
  for (std::size_t time = 0; time < times.size(); ++time)
    for (std::size_t channel = 0; channel < channels.size(); ++channel) {
      BuildJob& one = jobs.emplace_back(first);
      if (all_channels) {
        one.input.channel = static_cast<std::int64_t>(channel);
        one.output = outputOf(one.output, "channel", channels[channel]);
      }
      if (all_times) {
        one.input.time = static_cast<std::int64_t>(time);
        one.output = outputOf(one.output, "time", times[time]);
      }
    }
  return jobs;
}

}  // namespace isobrick
