#include "isobrick/viewer/serve/served_volumes.h"

#include <sys/stat.h>

#include <algorithm>
#include <charconv>
#include <glm/gtc/type_ptr.hpp>
#include <glm/mat4x4.hpp>
#include <utility>

#include "isobrick/storage/checksum.h"
#include "isobrick/viewer/stream/chunk_packet.h"

namespace isobrick {

namespace {

using VolumeJson = nlohmann::ordered_json;
using VolumeClock = std::chrono::steady_clock;

// Another one once another file has that path; empty: it is none of this machine.
std::string fileNow(const std::string& path) {
  struct stat facts {};
  if (stat(path.c_str(), &facts) != 0) return {};
  return std::to_string(facts.st_ino) + " " + std::to_string(facts.st_size) + " " +
         std::to_string(facts.st_mtim.tv_sec) + " " + std::to_string(facts.st_mtim.tv_nsec);
}

// Of a vector or, column after column, of a matrix.
template <typename T>
VolumeJson listOf(const T& numbers) {
  const auto* const first = glm::value_ptr(numbers);
  return std::vector(first, first + sizeof numbers / sizeof *first);
}

VolumeJson histogramJson(const ValueHistogram& histogram) {
  VolumeJson json{
      {"least", histogram.least}, {"greatest", histogram.greatest}, {"counts", histogram.counts}};
  for (const double edges : histogram.edges) json["triangles"].push_back(2.0 * edges);
  return json;
}

}  // namespace

ServedVolumes::ServedVolumes(std::vector<ServedVolume> volumes, VolumeBuilder build,
                             std::uint64_t memory_bytes, const RemoteOptions& remote)
    : build_(std::move(build)),
      memory_bytes_(memory_bytes / std::clamp<std::size_t>(volumes.size(), 1, kMostOpen)),
      remote_(remote) {
  for (ServedVolume& volume : volumes) volumes_.push_back({std::move(volume)});
}

std::size_t ServedVolumes::openCount() const {
  return static_cast<std::size_t>(std::count_if(
      volumes_.begin(), volumes_.end(),
      [](const Volume& volume) { return volume.opened != nullptr || volume.opener != nullptr; }));
}

std::shared_ptr<const OpenedVolume> ServedVolumes::open(std::size_t volume, std::string& error) {
  constexpr auto kTriedAgainAfter = std::chrono::seconds(10);
  Volume& wanted = volumes_[volume];
  const auto now = VolumeClock::now();
  if (!wanted.error.empty() && now - wanted.last_use < kTriedAgainAfter) {
    error = wanted.error;
    return nullptr;
  }
  wanted.last_use = now;
  const std::string file = fileNow(wanted.served.path);
  if (wanted.opened != nullptr && file != wanted.file) wanted.opened.reset();
  if (wanted.opened != nullptr || wanted.opener != nullptr) return wanted.opened;
  wanted.error.clear();
  if (!makeRoom()) {
    error = std::to_string(kMostOpen) + " volumes are in use, and no more can be open at once";
    return nullptr;
  }
  wanted.file = file;
  auto opener = std::make_unique<VolumeOpener>(build_, memory_bytes_, remote_);
  opener->open(wanted.served.path);
  wanted.opener = std::move(opener);  // one that could not begin would stay for ever
  return nullptr;
}

// Closes the one that was asked for least recently of those that nobody uses.
bool ServedVolumes::makeRoom() {
  if (openCount() < kMostOpen) return true;
  Volume* oldest = nullptr;
  for (Volume& volume : volumes_)
    if (volume.opened.use_count() == 1 && (oldest == nullptr || volume.last_use < oldest->last_use))
      oldest = &volume;
  if (oldest != nullptr) oldest->opened.reset();
  return oldest != nullptr;
}

void ServedVolumes::update() {
  for (Volume& volume : volumes_) {
    if (volume.opener == nullptr) continue;
    auto outcome = volume.opener->poll();
    if (!outcome) continue;
    volume.opener.reset();  // first: what it had is taken
    volume.error = std::move(outcome->error);
    volume.last_use = VolumeClock::now();
    if (outcome->volume)
      volume.opened = std::make_shared<const OpenedVolume>(std::move(*outcome->volume));
  }
}

VolumeJson ServedVolumes::entryOf(std::size_t number) const {
  const Volume& volume = volumes_[number];
  VolumeJson json{{"id", number}, {"name", volume.served.name}, {"state", "closed"}};
  if (volume.opened != nullptr) {
    json["state"] = "open";
  } else if (volume.opener != nullptr) {
    const VolumeOpener::Status status = volume.opener->status();
    json["state"] = "opening";
    json["phase"] = status.phase;
    json["share"] = status.share;
  } else if (!volume.error.empty()) {
    json["state"] = "failed";
    json["error"] = volume.error;
  }
  return json;
}

std::optional<VolumePath> volumePathOf(std::string_view path) {
  constexpr std::string_view kBegin = "/api/volume/";
  if (!path.starts_with(kBegin)) return std::nullopt;
  path.remove_prefix(kBegin.size());
  VolumePath result;
  const auto read = std::from_chars(path.data(), path.data() + path.size(), result.volume);
  if (read.ec != std::errc()) return std::nullopt;
  result.rest = path.substr(static_cast<std::size_t>(read.ptr - path.data()));
  if (!result.rest.empty() && result.rest.front() != '/') return std::nullopt;
  return result;
}

std::string editionOf(const OpenedVolume& volume) {
  const Pyramid& pyramid = *volume.file;
  const std::string& provenance = pyramid.provenance();
  const std::vector<double>& counts = volume.histogram.counts;
  std::uint64_t sum = checksum64(provenance.data(), provenance.size(), pyramid.fileBytes());
  sum = checksum64(counts.data(), counts.size() * sizeof(double), sum);
  return std::to_string(sum);
}

VolumeJson ServedVolumes::factsOf(std::size_t number) const {
  const OpenedVolume& volume = *volumes_[number].opened;
  const Pyramid& pyramid = *volume.file;
  const GridGeometry& geometry = pyramid.spec().geometry;
  glm::dmat4 index_to_world(geometry.indexToWorldMatrix());
  index_to_world[3] = glm::dvec4(geometry.origin, 1.0);
  VolumeJson json = entryOf(number);
  json.update({{"dimensions", listOf(pyramid.spec().voxels)},
               {"voxel_type", std::string(voxelTypeName(pyramid.spec().voxel_type))},
               {"spacing", listOf(geometry.spacing)},
               {"origin", listOf(geometry.origin)},
               {"direction", listOf(geometry.direction)},
               {"index_to_world", listOf(index_to_world)},
               {"unit", std::string(lengthUnitName(geometry.unit))},
               {"value_range", {pyramid.realRange().min, pyramid.realRange().max}},
               {"levels", pyramid.lattice().levels()},
               {"position_step", PositionSteps(pyramid.spec().voxels).step()},
               {"histogram", histogramJson(volume.histogram)},
               {"isovalues", volume.histogram.isovalues},
               {"edition", editionOf(volume)}});
  return json;
}

}  // namespace isobrick
