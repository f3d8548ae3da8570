// A chunk as a client gets it: docs/SERVE.md, "Chunks".
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>

#include "isobrick/storage/grid.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// The points that vertices of streams are rounded to: whole multiples of a step, which is a power
// of two of a voxel and one for the whole volume, so that a vertex of two chunks is the same in
// both.
class PositionSteps {
 public:
  // 1/128 voxel, or more if the longest axis then has more than 2^21 steps; at most 1/2.
  explicit PositionSteps(const Index3& voxels);

  double step() const { return step_; }  // voxels
  // Of a voxel index. What does not lie in a plane of voxels stays out of it, so crossings of
  // different edges stay apart, and centres of fans stay inside of their cells.
  glm::i32vec3 nearest(const glm::dvec3& index) const;

 private:
  double step_;
};

// Fills `packed` and empties vertices and triangles, for ChunkDelivery::pack. By any number of
// threads at once.
void packForClient(const PositionSteps& steps, SurfaceChunk& chunk);

// Of what packForClient() made. `volume`: the number that the client knows it by.
void setChunkNumber(std::span<std::byte> packet, std::uint32_t number, std::uint32_t volume);
std::uint32_t trianglesOfPacket(std::span<const std::byte> packet);

}  // namespace isobrick
