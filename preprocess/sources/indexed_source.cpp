#include "isobrick/preprocess/sources/indexed_source.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/preprocess/finite_voxels.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

using RecordJson = nlohmann::json;

// ---- how it is known

// Sizes and times of a source's files, of some of very many: bricks have checksums, too.
struct SourceStamp {
  std::uint64_t files = 0, bytes = 0;
  std::string times;

  explicit SourceStamp(const std::vector<std::string>& all) : files(all.size()) {
    constexpr std::size_t kMostFiles = 1024;
    std::vector<std::string> some;
    for (std::size_t i = 0; i < all.size(); i += (all.size() + kMostFiles - 1) / kMostFiles)
      some.push_back(all[i]);
    std::string facts;
    for (const InputWatch::Stamp& stamp : InputWatch::stampsOf(some)) {
      // Copies have the size and the time of the last change, and neither inode nor device.
      const std::array<std::int64_t, 3> kept = {stamp[2], stamp[3], stamp[4]};
      bytes += static_cast<std::uint64_t>(kept[0]);
      facts.append(reinterpret_cast<const char*>(kept.data()), sizeof kept);
    }
    char text[20];
    std::snprintf(text, sizeof text, "%016llx",
                  static_cast<unsigned long long>(checksum64(facts.data(), facts.size())));
    times = text;
  }
};

// What differs from the record, or nothing.
std::string changeOf(const SourceStamp& now, const RecordJson& record) {
  const auto number = [&](const char* key) {
    const RecordJson& json = member(record, key);
    return json.is_number_unsigned() ? json.get<std::uint64_t>() : 0;
  };
  if (now.files != number("files"))
    return concat("it has ", now.files, " files, and had ", number("files"));
  if (now.bytes != number("bytes"))
    return concat("it has ", now.bytes, " bytes, and had ", number("bytes"));
  if (now.times != textOf(member(record, "times")))
    return "it was written to at another time; a copy needs the time of the original";
  return {};
}

Error changedSource(const std::string& path, const std::string& index, const std::string& change) {
  return fileError(path, "'", path, "' changed since '", index, "' was built of it (", change,
                   "); put it back as it was, or build the index again");
}

// ---- how it is found

std::string pathFromIndex(const std::string& path, const std::string& index) {
  if (isRemotePath(path)) return path;
  const std::filesystem::path whole = absolutePath(path);
  const bool is_folder = lowerExtension(index) == kDividedEnding;
  const std::filesystem::path output = absolutePath(index);
  const std::filesystem::path relative =
      whole.lexically_relative(is_folder ? output : output.parent_path());
  const bool is_below = !relative.empty() && *relative.begin() != "..";
  return (is_below ? relative : whole).string();
}

std::string pathOfRecord(const std::string& index, const std::string& stored) {
  const bool is_whole = isRemotePath(stored) || stored.starts_with('/');
  if (!stored.empty() && !is_whole) return besidePath(pyramidFileOf(index), stored);
  if (stored.empty() || (isRemotePath(index) && !isRemotePath(stored)))
    throw fileError(index, "'", index,
                    "' does not say where its finest level lies, or names a file of another "
                    "machine; build it again");
  return stored;
}

// ---- how it is opened

RecordJson jsonOfOptions(const OpenOptions& options) {
  RecordJson json = RecordJson::object();
  if (options.raw)
    json["raw"] = {
        {"voxels", {options.raw->voxels.x, options.raw->voxels.y, options.raw->voxels.z}},
        {"type", options.raw->type},
        {"big_endian", options.raw->big_endian},
        {"offset", options.raw->offset_bytes}};
  const auto place = [&](const char* key, const std::optional<glm::dvec3>& v) {
    if (v) json[key] = {v->x, v->y, v->z};
  };
  place("spacing", options.spacing);
  place("origin", options.origin);
  const auto word = [&](const char* key, const std::string& text) {
    if (!text.empty()) json[key] = text;
  };
  word("unit", options.unit);
  word("spacing_unit", options.spacing_unit);
  word("origin_unit", options.origin_unit);
  word("grid", options.grid);
  if (options.time) json["time"] = *options.time;
  if (options.channel) json["channel"] = *options.channel;
  if (options.image) json["image"] = *options.image;
  if (options.component)
    json["component"] = options.component->magnitude ? RecordJson("magnitude")
                                                     : RecordJson(options.component->index);
  if (options.derivation.label) json["label"] = *options.derivation.label;
  return json;
}

// The text comes from a file, and may be anything: what is no option is left out, and what is read
// then is no such volume.
OpenOptions optionsOf(const RecordJson& json) {
  OpenOptions options;
  const auto whole = [&](const RecordJson& from) -> std::optional<std::int64_t> {
    if (!from.is_number_integer()) return std::nullopt;
    return from.get<std::int64_t>();
  };
  if (const RecordJson& raw = member(json, "raw"); raw.is_object()) {
    options.raw.emplace();
    const RecordJson& voxels = member(raw, "voxels");
    for (int axis = 0; axis < 3 && voxels.is_array() && voxels.size() == 3; ++axis)
      options.raw->voxels[axis] = whole(voxels[static_cast<std::size_t>(axis)]).value_or(0);
    options.raw->type = textOf(member(raw, "type"));
    options.raw->big_endian = member(raw, "big_endian") == RecordJson(true);
    options.raw->offset_bytes = static_cast<std::uint64_t>(
        std::max<std::int64_t>(whole(member(raw, "offset")).value_or(0), 0));
  }
  const auto place = [&](const char* key) -> std::optional<glm::dvec3> {
    const RecordJson& v = member(json, key);
    if (!v.is_array() || v.size() != 3) return std::nullopt;
    if (!v[0].is_number() || !v[1].is_number() || !v[2].is_number()) return std::nullopt;
    return glm::dvec3(v[0].get<double>(), v[1].get<double>(), v[2].get<double>());
  };
  options.spacing = place("spacing");
  options.origin = place("origin");
  options.unit = textOf(member(json, "unit"));
  options.spacing_unit = textOf(member(json, "spacing_unit"));
  options.origin_unit = textOf(member(json, "origin_unit"));
  options.grid = textOf(member(json, "grid"));
  options.time = whole(member(json, "time"));
  options.channel = whole(member(json, "channel"));
  options.image = whole(member(json, "image"));
  if (const RecordJson& component = member(json, "component"); component.is_string())
    options.component = ComponentChoice{.magnitude = true};
  else if (const auto index = whole(component))
    options.component = ComponentChoice{.index = *index};
  if (const RecordJson& label = member(json, "label"); label.is_number_unsigned())
    options.derivation.label = label.get<std::uint64_t>();
  return options;
}

// ---- its bricks

class VolumeBricks final : public SourceBricks {
 public:
  VolumeBricks(std::unique_ptr<VolumeSource> source, const BrickLayout& layout,
               const NotFinite& not_finite)
      : source_(std::move(source)), layout_(layout), not_finite_(not_finite) {}

  const std::string& path() const override { return source_->info().source; }
  std::uint64_t heldBytes() const override { return source_->bufferBytes(); }
  void copySamples(const Index3& brick, std::byte* out) const override {
    const IndexBox box = layout_.brickSampleBox(0, brick);
    source_->readBox(box, out);
    NotFiniteCounts counts;
    if (source_->info().voxel_type == VoxelType::kFloat32)
      makeFinite(reinterpret_cast<float*>(out), box, {}, not_finite_, source_->info(), counts);
  }
  void announce(std::span<const Index3> bricks) const override {
    std::vector<IndexBox> boxes;
    for (const Index3& brick : bricks) boxes.push_back(layout_.brickSampleBox(0, brick));
    source_->announce(boxes);
  }

 private:
  const std::unique_ptr<VolumeSource> source_;
  const BrickLayout layout_;
  const NotFinite not_finite_;
};

NotFinite notFiniteOf(const RecordJson& record, const ValueTransform& values) {
  NotFinite rule;
  if (const RecordJson& value = member(record, "nan_as"); value.is_number())
    rule.nan_as = static_cast<float>(values.stored(value.get<double>()));
  rule.masks_nan = member(record, "mask_nan") == RecordJson(true);
  return rule;
}

std::shared_ptr<const SourceBricks> openSourceOf(const SourceRequest& request) {
  const RecordJson provenance = parseShallowJson(request.provenance);
  const RecordJson& record = member(provenance, "level0");
  const std::string path = pathOfRecord(request.pyramid, textOf(member(record, "path")));
  const std::string edition = textOf(member(record, "edition"));
  // Before a reader says of a file that changed what it makes of it.
  if (isRegularFile(path) && member(record, "files") == RecordJson(1))
    if (const std::string change = changeOf(SourceStamp(std::vector{path}), record);
        !change.empty())
      throw changedSource(path, request.pyramid, change);
  OpenOptions options = optionsOf(member(record, "open"));
  options.memory_bytes = request.memory_bytes;
  options.cancel = request.cancel;
  std::unique_ptr<VolumeSource> source;
  try {
    source = openVolume(path, options);
  } catch (const Cancelled&) {
    throw;
  } catch (const Error& error) {
    throw Error(
        concat("'", request.pyramid, "' leaves its finest level in its source: ", error.what()),
        error.place(), error.remedies());
  }
  std::string change;
  if (!edition.empty())
    change = source->identity() == edition ? "" : "the server has another edition of it";
  else
    change = changeOf(SourceStamp(source->files()), record);
  if (!change.empty()) throw changedSource(path, request.pyramid, change);
  constexpr std::uint64_t kLittle = std::uint64_t{1} << 20;
  if (!source->readsBoxes() || source->bufferBytes() > 2 * request.memory_bytes + kLittle)
    throw fileError(path, "'", path,
                    "' takes more memory than the half of what is allowed that an index leaves "
                    "it, ",
                    request.memory_bytes >> 10,
                    " KiB; allow more, or build a pyramid of it in place of the index",
                    Remedy::kAllowMoreMemory);
  VolumeInfo chosen;
  chosen.voxel_type = request.spec.voxel_type;
  chosen.values = request.spec.values;
  source->chooseVoxelsAs(chosen);
  if (source->info().voxels != request.spec.voxels ||
      source->info().voxel_type != request.spec.voxel_type)
    throw changedSource(path, request.pyramid, "its voxels are others");
  return std::make_shared<VolumeBricks>(std::move(source), request.spec.layout(),
                                        notFiniteOf(record, request.spec.values));
}

}  // namespace

std::string sourceRecord(const VolumeSource& source, const OpenOptions& options,
                         const std::string& index) {
  const std::string& path = source.info().source;
  const std::vector<std::string> files = source.files();
  if (files.empty() && !isRemotePath(path))
    throw fileError(path, "'", path,
                    "' is no file that an index could leave its finest level in; build a pyramid "
                    "of it");
  if (!source.readsBoxes())
    throw fileError(path,
                    "an index leaves its finest level where it is, and bricks cannot be read "
                    "from '",
                    path,
                    "' one by one (it is packed, or its slices are read in order); build a pyramid "
                    "of it in place of the index");
  RecordJson record = {{"path", pathFromIndex(path, index)}, {"open", jsonOfOptions(options)}};
  if (files.empty()) {
    record["edition"] = source.identity();
  } else {
    const SourceStamp stamp(files);
    record["files"] = stamp.files;
    record["bytes"] = stamp.bytes;
    record["times"] = stamp.times;
  }
  return record.dump(-1, ' ', false, RecordJson::error_handler_t::replace);
}

SourceOpener volumeSourceOpener() { return openSourceOf; }

void readLevel0FromSources() { setSourceOpener(volumeSourceOpener()); }

}  // namespace isobrick
