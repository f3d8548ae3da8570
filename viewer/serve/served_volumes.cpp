#include "isobrick/viewer/serve/served_volumes.h"

#include <algorithm>
#include <glm/matrix.hpp>
#include <utility>

#include "isobrick/storage/checksum.h"
#include "isobrick/viewer/serve/chunk_packet.h"

namespace isobrick {

namespace {

using VolumeJson = nlohmann::ordered_json;
using VolumeClock = std::chrono::steady_clock;

template <typename Vector>
VolumeJson listOf(const Vector& v) {
  return {v.x, v.y, v.z};
}

VolumeJson columnsOf(const glm::dmat3& matrix) {
  VolumeJson list = VolumeJson::array();
  for (int column = 0; column < 3; ++column)
    for (int row = 0; row < 3; ++row) list.push_back(matrix[column][row]);
  return list;
}

VolumeJson indexToWorld(const GridGeometry& geometry) {
  VolumeJson list = VolumeJson::array();
  const glm::dmat3 matrix = geometry.indexToWorldMatrix();
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) list.push_back(matrix[column][row]);
    list.push_back(0);
  }
  for (int row = 0; row < 3; ++row) list.push_back(geometry.origin[row]);
  list.push_back(1);
  return list;
}

VolumeJson histogramJson(const ValueHistogram& histogram) {
  VolumeJson json{
      {"least", histogram.least}, {"greatest", histogram.greatest}, {"counts", histogram.counts}};
  if (histogram.edges.empty()) return json;
  VolumeJson& triangles = json["triangles"] = VolumeJson::array();
  for (const double edges : histogram.edges) triangles.push_back(2.0 * edges);
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
  if (wanted.opened != nullptr || wanted.opener != nullptr) return wanted.opened;
  if (!makeRoom()) {
    error = std::to_string(kMostOpen) + " volumes are in use, and no more can be open at once";
    return nullptr;
  }
  wanted.error.clear();
  wanted.opener = std::make_unique<VolumeOpener>(build_, memory_bytes_, remote_);
  wanted.opener->open(wanted.served.path);
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
    if (outcome->volume)
      volume.opened = std::make_shared<const OpenedVolume>(std::move(*outcome->volume));
    volume.error = outcome->error;
    volume.last_use = VolumeClock::now();
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

VolumeJson factsOf(std::size_t number, const std::string& name, const OpenedVolume& volume) {
  const Pyramid& pyramid = *volume.file;
  const GridGeometry& geometry = pyramid.spec().geometry;
  return {{"id", number},
          {"name", name},
          {"state", "open"},
          {"dimensions", listOf(pyramid.spec().voxels)},
          {"voxel_type", std::string(voxelTypeName(pyramid.spec().voxel_type))},
          {"spacing", listOf(geometry.spacing)},
          {"origin", listOf(geometry.origin)},
          {"direction", columnsOf(geometry.direction)},
          {"index_to_world", indexToWorld(geometry)},
          {"unit", std::string(lengthUnitName(geometry.unit))},
          {"value_range", {pyramid.realRange().min, pyramid.realRange().max}},
          {"levels", pyramid.lattice().levels()},
          {"position_step", PositionSteps(pyramid.spec().voxels).step()},
          {"histogram", histogramJson(volume.histogram)},
          {"isovalues", volume.histogram.isovalues},
          {"edition", editionOf(volume)}};
}

}  // namespace isobrick
