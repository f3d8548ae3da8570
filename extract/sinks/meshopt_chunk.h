// Some ten thousand triangles packed for EXT_meshopt_compression of glTF, in files or on their way
// to a browser.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "isobrick/extract/sinks/gltf_text.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// The points that positions of a packed mesh are rounded to: center + m * 2^exponent per axis, |m|
// < 2^23. One for the whole mesh, so that a vertex that is in two chunks is the same in both.
struct PositionLattice {
  glm::dvec3 center{0.0};
  int exponent = 0;

  // The step is a power of two and at most 1/8192 of the least spacing, half of the distance of
  // crossings from the ends of their edges, so that no two vertices fall together. Volumes that
  // reach over more than some 1,000 of that spacing get as fine a one as the range of m allows,
  // which is that of single precision at their ends.
  static PositionLattice of(const MeshFrame& frame);

  glm::i32vec3 nearest(const glm::dvec3& world) const;
  double step() const;
};

// The part of a chunk that one batch adds.
struct MeshoptPiece {
  std::vector<glm::i32vec3> positions;         // on the lattice
  std::vector<glm::vec3> normals;              // one a position
  std::vector<std::vector<float>> attributes;  // numbers, likewise
  std::vector<GltfColor> colors;               // likewise, or none
  std::vector<std::uint32_t> triangles, caps;  // three indices each
};

// Its bytes are the packed views one after the other, each padded to 4 bytes.
struct PackedChunk {
  // The first views; attributes and colours, in that order, triangles and caps come behind.
  enum View : std::size_t { kPositions, kNormals, kAttributes };
  // As the extension counts them: elements of the view, bytes of one, and packed bytes.
  struct ViewSize {
    std::uint64_t count = 0, stride = 0, offset = 0, bytes = 0;
  };
  std::vector<ViewSize> views;                                // count 0: there are no caps
  std::size_t triangles() const { return views.size() - 2; }  // their view
  std::size_t caps() const { return views.size() - 1; }
  std::vector<std::byte> bytes;
  glm::vec3 least{0.0f}, greatest{0.0f};  // of positions from the center
};

// Positions with the filter EXPONENTIAL, normals as four normalised shorts of 10 bits with the
// filter OCTAHEDRAL, attributes and colours as they are, triangles in an order that packs well,
// each beginning with any of its corners. All pieces have the same attributes; there is at least
// one triangle.
PackedChunk packChunk(const std::vector<MeshoptPiece>& pieces, const PositionLattice& lattice);

// Positions of 16 bits, from 0 on.
using ShortPosition = std::array<std::uint16_t, 4>;  // x, y, z and 0

// The same of one piece whose positions are 16 bits an axis, packed without a filter; no values,
// and no bounds. `normals`: one a position.
PackedChunk packShortChunk(std::vector<ShortPosition> positions, std::vector<glm::vec3> normals,
                           std::span<const std::uint32_t> triangles);

}  // namespace isobrick
