#include "isobrick/preprocess/input_identity.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/format.h"

namespace isobrick {
namespace {

// Headers are at the beginning, and a truncated file lacks its end.
constexpr std::uint64_t kEndBytes = std::uint64_t{64} << 10;
constexpr std::uint64_t kBlockBytes = std::uint64_t{4} << 10;
constexpr std::uint64_t kBlocks = 16;

void append(std::string& text, const InputFile& file, std::uint64_t offset, std::uint64_t bytes) {
  const std::size_t begin = text.size();
  text.resize(begin + bytes);
  const std::size_t got = file.readAt(offset, text.data() + begin, bytes);
  if (got < bytes)
    throw ResumableError(
        concat("cannot read '", file.path(), "': it ends at byte ", offset + got, " and had ",
               file.size(), " when it was opened; run again when nobody writes to it"),
        {.path = file.path()});
}

std::uint64_t contentSample(const InputFile& file) {
  const std::uint64_t bytes = file.size();
  std::string sample;
  append(sample, file, 0, std::min(bytes, kEndBytes));
  append(sample, file, bytes - std::min(bytes, kEndBytes), std::min(bytes, kEndBytes));
  for (std::uint64_t block = 1; block < kBlocks; ++block) {
    const std::uint64_t at = bytes / kBlocks * block;
    append(sample, file, at, std::min(bytes - at, kBlockBytes));
  }
  return checksum64(sample.data(), sample.size());
}

std::string identityWithoutFiles(const VolumeSource& source) {
  std::string text = source.identity();
  if (text.empty())
    throw std::logic_error("a volume source has neither files() nor an identity() of its own");
  // It is a line among others.
  std::ranges::replace(text, '\n', ' ');
  return text;
}

std::string identityOfFiles(const std::vector<std::string>& paths, const CancelFlag* cancel) {
  std::uint64_t total = 0;
  std::string facts;
  const auto add = [&](std::uint64_t number) {
    facts.append(reinterpret_cast<const char*>(&number), sizeof number);
  };
  for (const std::string& path : paths) {
    if (cancel != nullptr) cancel->check();
    const InputFile file(path);
    total += file.size();
    add(file.size());
    add(static_cast<std::uint64_t>(file.changedAt().tv_sec));
    add(static_cast<std::uint64_t>(file.changedAt().tv_nsec));
    add(contentSample(file));
  }
  char text[100];
  std::snprintf(text, sizeof text, "%zu files, %llu bytes, %016llx", paths.size(),
                static_cast<unsigned long long>(total),
                static_cast<unsigned long long>(checksum64(facts.data(), facts.size())));
  return text;
}

}  // namespace

std::string inputIdentity(const VolumeSource& source, const CancelFlag* cancel) {
  const std::vector<std::string> paths = source.files();
  return paths.empty() ? identityWithoutFiles(source) : identityOfFiles(paths, cancel);
}

// The stamps first: a change while the content is sampled shows at the next check.
InputWatch::InputWatch(const VolumeSource& source, const CancelFlag* cancel)
    : name_(source.info().source),
      cancel_(cancel),
      files_(source.files()),
      stamps_(stampsOf(files_)),
      identity_(inputIdentity(source, cancel)) {}

std::vector<InputWatch::Stamp> InputWatch::stampsOf(const std::vector<std::string>& files) {
  std::vector<Stamp> stamps;
  for (const std::string& file : files) {
    struct stat status = {};
    Stamp stamp = {};  // of a file that cannot be reached: opening it gives the reason
    if (stat(file.c_str(), &status) == 0)
      stamp = {static_cast<std::int64_t>(status.st_dev),
               static_cast<std::int64_t>(status.st_ino),
               static_cast<std::int64_t>(status.st_size),
               status.st_mtim.tv_sec,
               status.st_mtim.tv_nsec,
               status.st_ctim.tv_sec,
               status.st_ctim.tv_nsec};
    stamps.push_back(stamp);
  }
  return stamps;
}

void InputWatch::check() {
  if (stampsOf(files_) != stamps_) checkContent();
}

void InputWatch::checkContent() {
  std::vector<Stamp> stamps = stampsOf(files_);
  std::string now;
  try {
    // Without files there is nothing that could change.
    now = files_.empty() ? identity_ : identityOfFiles(files_, cancel_);
  } catch (const Cancelled&) {
    throw;
  } catch (const Error& error) {
    throw ResumableError(
        "whether '" + name_ + "' is still as it was cannot be told: " + error.what(),
        {.path = name_});
  }
  if (now != identity_)
    throw ResumableError(
        "'" + name_ +
            "' changed while it was read; put it back as it was, or build anew when "
            "nobody writes to it",
        {.path = name_});
  stamps_ = std::move(stamps);
}

namespace {

std::string jsonOfNumber(double number) { return nlohmann::json(number).dump(); }

}  // namespace

std::string noteOfMissing(std::uint64_t voxels) {
  return concat(voxels, " voxels are NaN and have no data: surfaces are open beside them");
}

std::string provenanceText(const VolumeSource& source, const BuildOptions& options,
                           const std::string& identity, const NotFiniteCounts& counts) {
  const VolumeInfo& info = source.info();
  nlohmann::json json = {{"tool", "isobrick " + options.tool_version},
                         {"source", info.source},
                         {"format", info.format},
                         {"filter", filterName(options.filter)},
                         {"identity", identity},
                         {"notes", info.notes}};
  for (const std::string& note : source.notesOfReading()) json["notes"].push_back(note);
  if (!info.properties.empty()) json["properties"] = info.properties;
  if (!options.source_record.empty()) {
    json["level0"] = nlohmann::json::parse(options.source_record);
    if (options.nan_as) json["level0"]["nan_as"] = *options.nan_as;
    if (options.mask_nan) json["level0"]["mask_nan"] = true;
  }
  if (const VolumeChannel* const channel = info.namedChannel()) {
    json["channel"] = {{"number", info.channel.number}, {"name", channel->name}};
    if (channel->color) json["channel"]["color"] = hexColorText(*channel->color);
  }
  // A file of a divided pyramid has a part of them.
  if (counts.replaced > 0)
    json["notes"].push_back(
        (options.super_cells > 0 ? std::string() : std::to_string(counts.replaced) + " ") +
        "voxels that were not finite became " + jsonOfNumber(static_cast<double>(*options.nan_as)));
  if (counts.missing > 0) json["notes"].push_back(noteOfMissing(counts.missing));
  // A path need not be UTF-8; a provenance that cannot be written would lose the whole build.
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string buildIdentity(const VolumeInfo& info, const std::string& input_identity,
                          const BuildOptions& options) {
  // Its numbers, without the bytes that fill the struct up.
  const auto hash = checksum64(&info.geometry, offsetof(GridGeometry, unit));
  std::string text = "input=" + input_identity + "\n";
  const auto line = [&](const char* name, const std::string& value) {
    text += std::string(name) + "=" + value + "\n";
  };
  line("voxels", indexText(info.voxels, "x") + " " +
                     std::string(voxelTypeName(info.numbers.value_or(info.voxel_type))));
  line("format", info.format + (info.encoding.empty() ? "" : ", ") + info.encoding);
  line("geometry", std::to_string(hash));
  line("length unit", std::string(lengthUnitName(info.geometry.unit)));
  line("filter", std::string(filterName(options.filter)));
  line("codec", std::string(codecName(options.codec)));
  line("brick", std::to_string(options.brick_cells));
  line("tile", std::to_string(options.tile_cells));
  line("curvature", options.with_curvature ? jsonOfNumber(options.curvature_epsilon) : "none");
  line("error", "none");  // as in programs that could store bounds of errors
  line("nan_as", options.nan_as ? jsonOfNumber(static_cast<double>(*options.nan_as)) : "none");
  if (options.mask_nan) line("mask_nan", "yes");
  if (!options.source_record.empty()) line("level 0", "in the source");
  if (options.super_cells > 0) line("super-brick", std::to_string(options.super_cells));
  line("version", std::to_string(format::kVersion));
  line("algorithm", std::to_string(kBuildAlgorithm));
  return text;
}

std::string buildIdentity(const VolumeSource& source, const BuildOptions& options) {
  return buildIdentity(source.info(), inputIdentity(source, options.cancel), options);
}

}  // namespace isobrick
