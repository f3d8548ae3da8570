#include "isobrick/extract/sinks/meshopt_chunk.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/vec4.hpp>

namespace isobrick {
namespace {

constexpr std::int32_t kMostSteps = (1 << 23) - 1;
constexpr int kNormalBits = 10;
constexpr unsigned int kCacheSize = 16;  // of vertices that the packed triangles refer to cheaply

// The only version of the extension; the library's default is an older one.
void chooseIndexVersion() {
  static const bool kDone = [] {
    meshopt_encodeIndexVersion(1);
    return true;
  }();
  static_cast<void>(kDone);
}

// The attribute of all pieces, one after the other.
template <typename T>
std::vector<T> allOf(const std::vector<MeshoptPiece>& pieces,
                     std::vector<T> MeshoptPiece::*attribute) {
  std::vector<T> all;
  for (const MeshoptPiece& piece : pieces)
    all.insert(all.end(), (piece.*attribute).begin(), (piece.*attribute).end());
  return all;
}

std::vector<std::uint32_t> allTriangles(const std::vector<MeshoptPiece>& pieces) {
  std::vector<std::uint32_t> all;
  std::uint32_t first = 0;
  for (const MeshoptPiece& piece : pieces) {
    for (const std::uint32_t corner : piece.triangles) all.push_back(first + corner);
    first += static_cast<std::uint32_t>(piece.positions.size());
  }
  return all;
}

class ChunkPacker {
 public:
  void addVertices(const void* data, std::size_t count, std::size_t stride) {
    buffer_.resize(meshopt_encodeVertexBufferBound(count, stride));
    add(count, stride,
        meshopt_encodeVertexBuffer(buffer_.data(), buffer_.size(), data, count, stride));
  }
  void addTriangles(const std::vector<std::uint32_t>& corners, std::size_t vertices) {
    buffer_.resize(meshopt_encodeIndexBufferBound(corners.size(), vertices));
    add(corners.size(), sizeof(std::uint32_t),
        meshopt_encodeIndexBuffer(buffer_.data(), buffer_.size(), corners.data(), corners.size()));
  }
  PackedChunk take() { return std::move(packed_); }

 private:
  void add(std::size_t count, std::size_t stride, std::size_t bytes) {
    packed_.views.push_back({count, stride, packed_.bytes.size(), bytes});
    const auto* const begin = reinterpret_cast<const std::byte*>(buffer_.data());
    packed_.bytes.insert(packed_.bytes.end(), begin, begin + bytes);
    packed_.bytes.resize((packed_.bytes.size() + 3) & ~std::size_t{3});
  }

  std::vector<unsigned char> buffer_;
  PackedChunk packed_;
};

}  // namespace

PositionLattice PositionLattice::of(const MeshFrame& frame) {
  PositionLattice lattice;
  const GridGeometry& geometry = frame.geometry;
  lattice.center = gltfCenter(frame);
  double reach = 0;
  for (const glm::dvec3& corner : worldCorners(geometry, frame.voxels)) {
    const glm::dvec3 away = glm::abs(corner - lattice.center);
    reach = std::max({reach, away.x, away.y, away.z});
  }
  const double finest = geometry.leastSpacing() / 8192;
  lattice.exponent = static_cast<int>(std::floor(std::log2(finest)));
  while (reach / lattice.step() > kMostSteps - 1) ++lattice.exponent;
  return lattice;
}

double PositionLattice::step() const { return std::ldexp(1.0, exponent); }

glm::i32vec3 PositionLattice::nearest(const glm::dvec3& world) const {
  const double most = kMostSteps;  // a vertex never lies outside the volume by more than rounding
  return glm::i32vec3(glm::clamp(glm::round((world - center) * std::ldexp(1.0, -exponent)),
                                 glm::dvec3(-most), glm::dvec3(most)));
}

PackedChunk packChunk(const std::vector<MeshoptPiece>& pieces, const PositionLattice& lattice) {
  chooseIndexVersion();
  std::vector<glm::i32vec3> positions = allOf(pieces, &MeshoptPiece::positions);
  std::vector<glm::vec3> normals = allOf(pieces, &MeshoptPiece::normals);
  const std::vector<std::uint32_t> triangles = allTriangles(pieces);

  // Triangles that share corners come together, vertices in the order in which triangles use them.
  std::vector<std::uint32_t> corners(triangles.size());
  meshopt_optimizeVertexCacheFifo(corners.data(), triangles.data(), triangles.size(),
                                  positions.size(), kCacheSize);
  std::vector<std::uint32_t> places(positions.size());
  const std::size_t count = meshopt_optimizeVertexFetchRemap(places.data(), corners.data(),
                                                             corners.size(), positions.size());
  meshopt_remapIndexBuffer(corners.data(), corners.data(), corners.size(), places.data());
  const auto rearrange = [&](auto& attribute) {
    meshopt_remapVertexBuffer(attribute.data(), attribute.data(), attribute.size(),
                              sizeof attribute[0], places.data());
  };
  rearrange(positions);
  rearrange(normals);

  ChunkPacker packer;
  glm::i32vec3 least = positions[0], greatest = positions[0];
  std::vector<std::uint32_t> numbers(3 * count);
  for (std::size_t v = 0; v < count; ++v) {
    least = glm::min(least, positions[v]);
    greatest = glm::max(greatest, positions[v]);
    // The exponent above a mantissa of 24 bits.
    for (int axis = 0; axis < 3; ++axis)
      numbers[3 * v + static_cast<std::size_t>(axis)] =
          static_cast<std::uint32_t>(lattice.exponent) << 24 |
          (static_cast<std::uint32_t>(positions[v][axis]) & 0xFFFFFF);
  }
  packer.addVertices(numbers.data(), count, 12);

  std::vector<glm::vec4> units(count);
  for (std::size_t v = 0; v < count; ++v) units[v] = glm::vec4(normals[v], 0.0f);
  std::vector<std::int16_t> shorts(4 * count);
  meshopt_encodeFilterOct(shorts.data(), count, 8, kNormalBits, &units[0].x);
  packer.addVertices(shorts.data(), count, 8);

  for (std::size_t a = 0; a < pieces.front().attributes.size(); ++a) {
    std::vector<float> values;
    for (const MeshoptPiece& piece : pieces)
      values.insert(values.end(), piece.attributes[a].begin(), piece.attributes[a].end());
    rearrange(values);
    packer.addVertices(values.data(), count, sizeof values[0]);
  }
  if (std::vector<GltfColor> colors = allOf(pieces, &MeshoptPiece::colors); !colors.empty()) {
    rearrange(colors);
    packer.addVertices(colors.data(), count, sizeof colors[0]);
  }
  packer.addTriangles(corners, count);
  PackedChunk packed = packer.take();
  // Exact: a float has 24 bits.
  packed.least = glm::vec3(glm::dvec3(least) * lattice.step());
  packed.greatest = glm::vec3(glm::dvec3(greatest) * lattice.step());
  return packed;
}

}  // namespace isobrick
