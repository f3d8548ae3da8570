#include "tools/build/volume_facts.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

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

}  // namespace

Json factsOfVolume(VolumeSource& source, const BuildOptions& options) {
  const VolumeInfo& info = source.info();
  const GridGeometry& geometry = info.geometry;
  VoxelSample sample;
  const bool is_far = isRemotePath(info.source);  // the facts cost its metadata alone
  if (!is_far && (source.readsBoxes() || volumeBytes(info) <= kMostBytesInOrder))
    visitVoxelType(info.voxel_type,
                   [&](auto tag) { sample = sampleVoxels<typename decltype(tag)::Type>(source); });
  std::vector<std::string> notes = info.notes;
  for (std::string& note : source.notesOfReading()) notes.push_back(std::move(note));
  const BrickLayout layout(Lattice(info.voxels), options.brick_cells, options.tile_cells);
  Json levels = Json::array();
  for (int level = 0; level < layout.lattice().levels(); ++level)
    levels.push_back({{"level", level},
                      {"dimensions", jsonOf(layout.lattice().samples(level))},
                      {"bricks", elementCount(layout.bricks(level))}});
  Json json = Json::object();
  json["volume"] = info.source;
  json["pyramid"] = nullptr;
  json["format"] = info.format;
  json["dimensions"] = jsonOf(info.voxels);
  json["voxel_type"] = voxelTypeName(info.voxel_type);
  json["spacing"] = jsonOf(geometry.spacing);
  json["origin"] = jsonOf(geometry.origin);
  json["length_unit"] = lengthUnitName(geometry.unit);
  json["direction"] = {jsonOf(geometry.direction[0]), jsonOf(geometry.direction[1]),
                       jsonOf(geometry.direction[2])};
  json["time_steps"] = info.time_step.count;
  json["channels"] = Json::array();
  for (std::int64_t number = 0; number < std::min(info.channel.count, kMostChannels); ++number) {
    Json& channel = json["channels"].emplace_back(Json{{"name", ""}, {"color", nullptr}});
    if (number >= std::ssize(info.named_channels)) continue;
    const VolumeChannel& named = info.named_channels[static_cast<std::size_t>(number)];
    channel["name"] = named.name;
    if (named.color) channel["color"] = hexColorText(*named.color);
  }
  json["value_range"] = nullptr;
  const auto valueOf = [&](double stored) {
    return info.values.offset + info.values.scale * stored;
  };
  if (sample.voxels > 0) json["value_range"] = {valueOf(sample.least), valueOf(sample.greatest)};
  json["stored_values"] = {{"scale", info.values.scale}, {"offset", info.values.offset}};
  json["sampled_voxels"] = sample.voxels;
  json["levels"] = levels;
  json["bytes"] = {{"total", nullptr}, {"raw", volumeBytes(info)}};
  json["notes"] = notes;
  return json;
}

}  // namespace isobrick
