// The vertices of chunks by their places: two chunks that have the same one have the same bits.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <unordered_map>

#include "isobrick/storage/checksum.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// Numbers for the vertices of one surface: the same place has the same one. The edge of the lattice
// that a vertex lies on is not a part of a chunk, but its position is the same to the bit on both
// sides of a brick, and no two edges have a crossing in one place (docs/ALGORITHM.md, rule 8).
class VertexPlaces {
 public:
  // `next`: for a place that is new. In the scene's lattice.
  std::uint64_t numberOf(const SurfaceChunk& chunk, const SurfaceVertex& vertex,
                         std::uint64_t next) {
    // Adding 0 makes the two zeros one.
    const glm::dvec3 at = chunk.origin + glm::dvec3(vertex.position) + 0.0;
    return numbers_.try_emplace({at.x, at.y, at.z}, next).first->second;
  }
  std::size_t size() const { return numbers_.size(); }

 private:
  using Place = std::array<double, 3>;
  struct Hash {
    std::size_t operator()(const Place& place) const {
      return checksum64(place.data(), sizeof(Place));
    }
  };
  std::unordered_map<Place, std::uint64_t, Hash> numbers_;
};

}  // namespace isobrick
