#include "isobrick/viewer/stream/chunk_packet.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <glm/common.hpp>
#include <limits>
#include <utility>
#include <vector>

#include "isobrick/extract/sinks/meshopt_chunk.h"

namespace isobrick {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::size_t kNumberAt = 4, kTrianglesAt = 28, kVolumeAt = 44;

struct PacketHeader {
  std::array<char, 4> magic{'I', 'S', 'B', 'C'};
  std::uint32_t number = 0;
  std::uint16_t surface = 0;
  std::uint8_t level = 0;
  std::uint8_t is_wide = 0;
  std::array<std::int32_t, 3> origin{};
  std::uint32_t vertices = 0, triangles = 0;
  std::array<std::uint32_t, 3> packed_bytes{};
  std::uint32_t volume = 0;
};
static_assert(sizeof(PacketHeader) == 48);
static_assert(offsetof(PacketHeader, number) == kNumberAt);
static_assert(offsetof(PacketHeader, triangles) == kTrianglesAt);
static_assert(offsetof(PacketHeader, volume) == kVolumeAt);

constexpr int kBits = 16, kHighBits = 5;
constexpr double kMostSteps = (1 << (kBits + kHighBits)) - 1;

ShortPosition shortOf(const glm::i32vec3& from_origin) {
  ShortPosition position{};
  unsigned high = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto steps = static_cast<std::uint32_t>(from_origin[axis]);
    position[static_cast<std::size_t>(axis)] = static_cast<std::uint16_t>(steps & 0xFFFF);
    high |= (steps >> kBits) << (kHighBits * axis);
  }
  position[3] = static_cast<std::uint16_t>(high);
  return position;
}

}  // namespace

PositionSteps::PositionSteps(const Index3& voxels) : step_(1.0 / 128) {
  const auto longest = static_cast<double>(std::max({voxels.x, voxels.y, voxels.z}) - 1);
  while (longest / step_ > kMostSteps && step_ < 0.5) step_ *= 2;
}

glm::i32vec3 PositionSteps::nearest(const glm::dvec3& index) const {
  glm::i32vec3 steps(0);
  for (int axis = 0; axis < 3; ++axis) {
    const double at = index[axis];
    double nearest = std::round(at / step_);
    const double rounded = nearest * step_;
    if (rounded == std::floor(rounded) && rounded != at) nearest += at > rounded ? 1.0 : -1.0;
    steps[axis] = static_cast<std::int32_t>(nearest);
  }
  return steps;
}

void packForClient(const PositionSteps& steps, SurfaceChunk& chunk) {
  if (chunk.triangles.empty()) {
    chunk.vertices = {};
    return;
  }
  std::vector<glm::i32vec3> places;
  places.reserve(chunk.vertices.size());
  glm::i32vec3 origin(std::numeric_limits<std::int32_t>::max());
  for (const SurfaceVertex& vertex : chunk.vertices) {
    places.push_back(steps.nearest(chunk.origin + glm::dvec3(vertex.position)));
    origin = glm::min(origin, places.back());
  }
  std::vector<ShortPosition> positions;
  std::vector<glm::vec3> normals;
  positions.reserve(places.size());
  normals.reserve(places.size());
  PacketHeader header;
  for (const glm::i32vec3& place : places) {
    positions.push_back(shortOf(place - origin));
    if (positions.back()[3] != 0) header.is_wide = 1;
  }
  for (const SurfaceVertex& vertex : chunk.vertices) normals.push_back(unpackNormal(vertex.normal));
  const PackedChunk packed =
      packShortChunk(std::move(positions), std::move(normals), chunk.triangles);

  header.surface = static_cast<std::uint16_t>(chunk.surface);
  header.level = static_cast<std::uint8_t>(chunk.level);
  header.origin = {origin.x, origin.y, origin.z};
  const std::size_t kViews[] = {PackedChunk::kPositions, PackedChunk::kNormals, packed.triangles()};
  header.vertices = static_cast<std::uint32_t>(packed.views[PackedChunk::kPositions].count);
  header.triangles = static_cast<std::uint32_t>(chunk.triangles.size() / 3);
  for (std::size_t view = 0; view < 3; ++view)
    header.packed_bytes[view] = static_cast<std::uint32_t>(packed.views[kViews[view]].bytes);
  chunk.packed.resize(sizeof header + packed.bytes.size());
  std::memcpy(chunk.packed.data(), &header, sizeof header);
  std::memcpy(chunk.packed.data() + sizeof header, packed.bytes.data(), packed.bytes.size());
  chunk.vertices = {};
  chunk.triangles = {};
}

void setChunkNumber(std::span<std::byte> packet, std::uint32_t number, std::uint32_t volume) {
  std::memcpy(packet.data() + kNumberAt, &number, sizeof number);
  std::memcpy(packet.data() + kVolumeAt, &volume, sizeof volume);
}

std::uint32_t trianglesOfPacket(std::span<const std::byte> packet) {
  std::uint32_t triangles = 0;
  std::memcpy(&triangles, packet.data() + kTrianglesAt, sizeof triangles);
  return triangles;
}

}  // namespace isobrick
