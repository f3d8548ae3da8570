#include "isobrick/viewer/serve/served_volumes.h"

#include <algorithm>
#include <glm/gtc/type_ptr.hpp>
#include <glm/mat4x4.hpp>
#include <utility>

#include "isobrick/storage/checksum.h"
#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/stream/chunk_packet.h"

namespace isobrick {

namespace {

using VolumeJson = nlohmann::ordered_json;

// Of a vector or, column after column, of a matrix.
template <typename T>
VolumeJson listOf(const T& numbers) {
  const auto* const first = glm::value_ptr(numbers);
  return std::vector(first, first + sizeof numbers / sizeof *first);
}

}  // namespace

ServedVolumes::ServedVolumes(const std::vector<ServedVolume>& volumes, VolumeBuilder build,
                             std::uint64_t memory_bytes, const RemoteOptions& remote)
    : build_(std::move(build)),
      memory_bytes_(memory_bytes / std::clamp<std::size_t>(volumes.size(), 1, kMostOpen)),
      remote_(remote) {
  for (const ServedVolume& volume : volumes) volumes_.push_back({volume});
}

std::size_t ServedVolumes::openCount() const {
  return static_cast<std::size_t>(std::count_if(
      volumes_.begin(), volumes_.end(),
      [](const Volume& volume) { return volume.opened != nullptr || volume.opener != nullptr; }));
}

ServedVolumes::Opened ServedVolumes::open(std::size_t number) {
  constexpr auto kTriedAgainAfter = std::chrono::seconds(10);
  Volume& volume = volumes_[number];
  if (volume.opener != nullptr) return nullptr;
  const auto now = std::chrono::steady_clock::now();
  require(volume.error.empty() || now - volume.last_use >= kTriedAgainAfter, 500, volume.error);
  volume.last_use = now;
  const std::string file = fileStamp(volume.served.path);
  if (volume.opened != nullptr && file != volume.file) volume.opened.reset();
  if (volume.opened != nullptr) return volume.opened;
  volume.error.clear();
  makeRoom();
  volume.file = file;
  volume.opener = std::make_unique<VolumeOpener>(build_, memory_bytes_, remote_);
  volume.opener->open(volume.served.path);
  return nullptr;
}

// Closes the one that was asked for least recently of those that nobody uses.
void ServedVolumes::makeRoom() {
  if (openCount() < kMostOpen) return;
  Volume* oldest = nullptr;
  for (Volume& volume : volumes_)
    if (volume.opened.use_count() == 1 && (oldest == nullptr || volume.last_use < oldest->last_use))
      oldest = &volume;
  require(oldest != nullptr, 503,
          std::to_string(kMostOpen) + " volumes are in use, and no more can be open at once");
  oldest->opened.reset();
}

void ServedVolumes::update() {
  for (Volume& volume : volumes_) {
    if (volume.opener == nullptr) continue;
    auto outcome = volume.opener->poll();
    if (!outcome) continue;
    if (outcome->volume)
      volume.opened = std::make_shared<const OpenedVolume>(std::move(*outcome->volume));
    volume.error = outcome->error;
    volume.last_use = std::chrono::steady_clock::now();
    volume.opener.reset();
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
  const ValueHistogram& histogram = volume.histogram;
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
               {"histogram",
                {{"least", histogram.least},
                 {"greatest", histogram.greatest},
                 {"counts", histogram.counts}}},
               {"isovalues", histogram.isovalues},
               {"edition", editionOf(volume)}});
  for (const double edges : histogram.edges) json["histogram"]["triangles"].push_back(2.0 * edges);
  return json;
}

}  // namespace isobrick
