#include "tools/build/build_report.h"

#include <fmt/format.h>

#include "tools/byte_size.h"
#include "tools/line_words.h"

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

}  // namespace

std::string codecOptionName(format::Codec codec) {
  return codec == format::Codec::kStored ? "none" : std::string(codecName(codec));
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

}  // namespace isobrick
