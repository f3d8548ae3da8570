#include "isobrick/extract/sinks/meshopt_chunk.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/vec4.hpp>
#include <span>

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

std::vector<std::uint32_t> allTriangles(const std::vector<MeshoptPiece>& pieces,
                                        std::vector<std::uint32_t> MeshoptPiece::*triangles) {
  std::vector<std::uint32_t> all;
  std::uint32_t first = 0;
  for (const MeshoptPiece& piece : pieces) {
    for (const std::uint32_t corner : piece.*triangles) all.push_back(first + corner);
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
  void addNormals(const std::vector<glm::vec3>& normals, std::size_t count) {
    std::vector<glm::vec4> units(count);
    for (std::size_t v = 0; v < count; ++v) units[v] = glm::vec4(normals[v], 0.0f);
    std::vector<std::int16_t> shorts(4 * count);
    meshopt_encodeFilterOct(shorts.data(), count, 8, kNormalBits, &units[0].x);
    addVertices(shorts.data(), count, 8);
  }
  void addTriangles(std::span<const std::uint32_t> corners, std::size_t vertices) {
    if (corners.empty()) return add(0, sizeof(std::uint32_t), 0);
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

// Triangles that share corners come together, vertices in the order in which triangles use them.
class Arrangement {
 public:
  Arrangement(std::span<const std::uint32_t> surface, std::span<const std::uint32_t> caps,
              std::size_t vertices)
      : corners_(surface.size() + caps.size()), surface_(surface.size()), places_(vertices) {
    optimize(surface, corners_.data());
    optimize(caps, corners_.data() + surface_);
    count_ = meshopt_optimizeVertexFetchRemap(places_.data(), corners_.data(), corners_.size(),
                                              vertices);
    meshopt_remapIndexBuffer(corners_.data(), corners_.data(), corners_.size(), places_.data());
  }
  template <typename T>
  void rearrange(std::vector<T>& attribute) const {
    meshopt_remapVertexBuffer(attribute.data(), attribute.data(), attribute.size(), sizeof(T),
                              places_.data());
  }
  std::span<const std::uint32_t> surface() const { return std::span(corners_).first(surface_); }
  std::span<const std::uint32_t> caps() const { return std::span(corners_).subspan(surface_); }
  std::size_t vertices() const { return count_; }  // that triangles use

 private:
  void optimize(std::span<const std::uint32_t> triangles, std::uint32_t* corners) const {
    meshopt_optimizeVertexCacheFifo(corners, triangles.data(), triangles.size(), places_.size(),
                                    kCacheSize);
  }

  std::vector<std::uint32_t> corners_;  // of the surface, then of caps
  std::size_t surface_;
  std::vector<std::uint32_t> places_;
  std::size_t count_ = 0;
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

  const std::vector<std::uint32_t> surface = allTriangles(pieces, &MeshoptPiece::triangles),
                                   caps = allTriangles(pieces, &MeshoptPiece::caps);
  const Arrangement arrangement(surface, caps, positions.size());
  const std::size_t count = arrangement.vertices();
  arrangement.rearrange(positions);
  arrangement.rearrange(normals);

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

  packer.addNormals(normals, count);
  for (std::size_t a = 0; a < pieces.front().attributes.size(); ++a) {
    std::vector<float> values;
    for (const MeshoptPiece& piece : pieces)
      values.insert(values.end(), piece.attributes[a].begin(), piece.attributes[a].end());
    arrangement.rearrange(values);
    packer.addVertices(values.data(), count, sizeof values[0]);
  }
  if (std::vector<GltfColor> colors = allOf(pieces, &MeshoptPiece::colors); !colors.empty()) {
    arrangement.rearrange(colors);
    packer.addVertices(colors.data(), count, sizeof colors[0]);
  }
  packer.addTriangles(arrangement.surface(), count);
  packer.addTriangles(arrangement.caps(), count);
  PackedChunk packed = packer.take();
  // Exact: a float has 24 bits.
  packed.least = glm::vec3(glm::dvec3(least) * lattice.step());
  packed.greatest = glm::vec3(glm::dvec3(greatest) * lattice.step());
  return packed;
}

PackedChunk packShortChunk(std::vector<ShortPosition> positions, std::vector<glm::vec3> normals,
                           std::span<const std::uint32_t> triangles) {
  chooseIndexVersion();
  const Arrangement arrangement(triangles, {}, positions.size());
  arrangement.rearrange(positions);
  arrangement.rearrange(normals);
  ChunkPacker packer;
  packer.addVertices(positions.data(), arrangement.vertices(), sizeof(ShortPosition));
  packer.addNormals(normals, arrangement.vertices());
  packer.addTriangles(arrangement.surface(), arrangement.vertices());
  packer.addTriangles(arrangement.caps(), arrangement.vertices());
  return packer.take();
}

}  // namespace isobrick
