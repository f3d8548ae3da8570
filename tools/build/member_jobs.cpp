#include "tools/build/member_jobs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "isobrick/storage/error.h"
#include "tools/output_names.h"

namespace isobrick {
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

std::string missingPlace(const InputOptions& input, const std::string& output) {
  if (input.all_channels && !hasPlace(output, "channel")) return "channel";
  if (input.all_times && !hasPlace(output, "time")) return "time";
  return {};
}

std::string idlePlace(const InputOptions& input, const std::string& output) {
  if (!input.all_channels && hasPlace(output, "channel")) return "channel";
  if (!input.all_times && hasPlace(output, "time")) return "time";
  return {};
}

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
