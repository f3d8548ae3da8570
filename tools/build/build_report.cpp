#include "tools/build/build_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/remote_options.h"
#include "tools/plain_text.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

// A rate of nothing is no number.
Json jsonOfRate(double megabytes_per_second) {
  return megabytes_per_second > 0 ? Json(megabytes_per_second) : Json(nullptr);
}

std::string rateText(double megabytes_per_second) {
  return megabytes_per_second > 0 ? fmt::format("{:.0f}", megabytes_per_second) : "-";
}

Json jsonOfPhases(const BuiltVolume& built) {
  Json phases = Json::object();
  for (const BuildPhase& phase : built.report.phases)
    phases[phase.name] = {
        {"busy_seconds", phase.busy_seconds},
        {"megabytes_per_second", jsonOfRate(built.megabytesPerSecond(phase.busy_seconds))}};
  return phases;
}

std::string dimensionsText(const VolumeInfo& volume) {
  return fmt::format("{} x {} x {} {}", volume.voxels.x, volume.voxels.y, volume.voxels.z,
                     voxelTypeName(volume.voxel_type));
}

std::string sizeText(const PyramidBytes& bytes) {
  return fmt::format("{} ({:.2f} x raw)", byteSizeText(bytes.total),
                     static_cast<double>(bytes.total) / static_cast<double>(bytes.raw));
}

void printPhases(const BuiltVolume& built) {
  fmt::print("{:<10} {:>8} {:>8}\n", "phase", "busy s", "MB/s");
  for (const BuildPhase& phase : built.report.phases)
    fmt::print("{:<10} {:>8.2f} {:>8}\n", phase.name, phase.busy_seconds,
               rateText(built.megabytesPerSecond(phase.busy_seconds)));
}

// A source that is read in order unpacks what is passed over, too.
constexpr std::uint64_t kMostBytesInOrder = std::uint64_t{1} << 30;
constexpr std::int64_t kPlaces = 32;
constexpr std::int64_t kMostChannels = 4096;  // hostile files count what they like
constexpr std::uint64_t kBytesAtAPlace = std::uint64_t{1} << 20;

struct VoxelSample {
  double least = 0, greatest = 0;
  std::int64_t voxels = 0;  // that have a value
};

// Rows at places that are spread from the first to the last.
template <typename T>
VoxelSample sampleVoxels(VolumeSource& source) {
  const Index3 voxels = source.info().voxels;
  const std::int64_t rows = voxels.y * voxels.z;
  const std::int64_t run = std::clamp<std::int64_t>(
      static_cast<std::int64_t>(kBytesAtAPlace / rowBytes(source.info())), 1, rows);
  const std::int64_t places = std::min(kPlaces, rows / run);
  std::vector<T> values(static_cast<std::size_t>(run * voxels.x));
  VoxelSample sample;
  for (std::int64_t place = 0; place < places; ++place) {
    source.readRows(places == 1 ? 0 : place * (rows - run) / (places - 1), run, values.data());
    for (const T value : values) {
      const auto number = static_cast<double>(value);
      if (!std::isfinite(number)) continue;
      sample.least = sample.voxels == 0 ? number : std::min(sample.least, number);
      sample.greatest = sample.voxels == 0 ? number : std::max(sample.greatest, number);
      ++sample.voxels;
    }
  }
  return sample;
}

Json jsonOfChannels(const VolumeInfo& info) {
  Json channels = Json::array();
  for (std::int64_t number = 0; number < std::min(info.channel.count, kMostChannels); ++number) {
    Json& channel = channels.emplace_back(Json{{"name", ""}, {"color", nullptr}});
    if (number >= std::ssize(info.named_channels)) continue;
    const VolumeChannel& named = info.named_channels[static_cast<std::size_t>(number)];
    channel["name"] = named.name;
    if (named.color) channel["color"] = hexColorText(*named.color);
  }
  return channels;
}

}  // namespace

std::string codecOptionName(format::Codec codec) {
  return codec == format::Codec::kStored ? "none" : std::string(codecName(codec));
}

void addStoredOptions(CLI::App& app, BuildOptions& options) {
  Choices<format::Codec> codecs;
  for (const auto codec : {format::Codec::kStored, format::Codec::kLz4, format::Codec::kZstd})
    codecs.emplace_back(codecOptionName(codec), codec);
  addChoiceOption(app, "--codec", options.codec, codecs, "C",
                  "How the bricks of an .isb are packed: none, lz4 or zstd; default: " +
                      codecOptionName(options.codec));
  app.add_flag_callback(
      "--no-curvature", [&options] { options.with_curvature = false; },
      "Leave out what extract needs for --curvature; builds an .isb faster");
}

Json jsonOfBuilt(const BuildJob& job, const BuiltVolume& built, const BuildSettings& settings) {
  Json json = Json::object();
  json["input"] = job.input.path;
  if (!built.facts.is_null()) {
    json["output"] = nullptr;
    json["facts"] = built.facts;
    return json;
  }
  json["output"] = built.output;
  json["skipped"] = built.skipped;
  json["dimensions"] = jsonOf(built.volume.voxels);
  json["voxel_type"] = voxelTypeName(built.volume.voxel_type);
  json["time_steps"] = built.volume.time_step.count;
  json["channels"] = jsonOfChannels(built.volume);
  json["levels"] = built.levels;
  json["bricks"] = built.bricks;
  json["bricks_resumed"] = built.report.bricks_resumed;
  json["codec"] = codecOptionName(settings.options.codec);
  json["index"] = settings.index;
  json["seconds"] = {
      {"total", built.seconds}, {"open", built.open_seconds}, {"build", built.report.seconds}};
  json["phases"] = jsonOfPhases(built);
  json["bytes"] = jsonOfBytes(built.bytes);
  json["notes"] = built.volume.notes;
  json["threads"] = settings.threads;
  json["memory_bytes"] = settings.options.memory_bytes;
  json["peak_rss_bytes"] = peakResidentBytes();
  json["megabytes_per_second"] = jsonOfRate(built.megabytesPerSecond(built.seconds));
  return json;
}

void printBuilt(const BuiltVolume& built, const BuildSettings& settings) {
  if (built.skipped) {
    fmt::print("{}: skipped: up to date (--rebuild builds it all the same)\n", built.output);
    return;
  }
  fmt::print("{}: {}, {} levels, {}, codec {}\n", built.output, dimensionsText(built.volume),
             built.levels, sizeText(built.bytes), codecOptionName(settings.options.codec));
  if (settings.index) fmt::print("level 0 stays in {}\n", oneLine(built.volume.source));
  for (const std::string& note : built.volume.notes) fmt::print("note: {}\n", note);
  if (built.report.bricks_resumed > 0)
    fmt::print("resumed: {} of {} bricks are of an earlier run; rates are of the rest\n",
               countText(built.report.bricks_resumed), countText(built.bricks));
  if (settings.verbose) printPhases(built);
  fmt::print(
      "{:.2f} s (open {:.2f}, build {:.2f}); {} MB/s; {} threads; peak memory {}, --memory {}\n",
      built.seconds, built.open_seconds, built.report.seconds,
      rateText(built.megabytesPerSecond(built.seconds)), settings.threads,
      byteSizeText(peakResidentBytes()), byteSizeText(settings.options.memory_bytes));
}

std::string builtLine(const BuiltVolume& built) {
  if (built.skipped) return fmt::format("{}: skipped: up to date", oneLine(built.output));
  std::string line = fmt::format("{}: {}, {}, {:.2f} s, {} MB/s", oneLine(built.output),
                                 dimensionsText(built.volume), sizeText(built.bytes), built.seconds,
                                 rateText(built.megabytesPerSecond(built.seconds)));
  if (built.report.bricks_resumed > 0)
    line += fmt::format(", {} of {} bricks resumed", countText(built.report.bricks_resumed),
                        countText(built.bricks));
  for (const std::string& note : built.volume.notes) line += "; note: " + oneLine(note);
  return line;
}

Json factsOfVolume(VolumeSource& source, const BuildOptions& options) {
  const VolumeInfo& info = source.info();
  VoxelSample sample;
  const bool is_far = isRemotePath(info.source);  // the facts cost its metadata alone
  if (!is_far && (source.readsBoxes() || volumeBytes(info) <= kMostBytesInOrder))
    visitVoxelType(info.voxel_type,
                   [&](auto tag) { sample = sampleVoxels<typename decltype(tag)::Type>(source); });
  std::vector<std::string> notes = info.notes;
  for (std::string& note : source.notesOfReading()) notes.push_back(std::move(note));
  const BrickLayout layout(Lattice(info.voxels), options.brick_cells, options.tile_cells);
  Json json = Json::object();
  json["volume"] = info.source;
  json["pyramid"] = nullptr;
  json["format"] = info.format;
  putGrid(info.voxels, info.voxel_type, info.geometry, json);
  json["time_steps"] = info.time_step.count;
  json["channels"] = jsonOfChannels(info);
  json["value_range"] = nullptr;
  const auto valueOf = [&](double stored) {
    return info.values.offset + info.values.scale * stored;
  };
  if (sample.voxels > 0) json["value_range"] = {valueOf(sample.least), valueOf(sample.greatest)};
  json["stored_values"] = {{"scale", info.values.scale}, {"offset", info.values.offset}};
  json["sampled_voxels"] = sample.voxels;
  json["levels"] = jsonOfLevels(layout);
  json["bytes"] = {{"total", nullptr}, {"raw", volumeBytes(info)}};
  json["notes"] = notes;
  return json;
}

}  // namespace isobrick
