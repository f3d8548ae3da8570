// Pieces of a surface that are smaller than a distance.
#pragma once

#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Drops small connected components of batches, with memory that goes round.
class SmallComponents {
 public:
  // Takes away the components of a batch whose box has a diagonal below `distance`; `to_space` goes
  // from voxels to the space in which distances count, and the box has its axes there. A component
  // with a vertex that other batches may have stays: nobody here knows how large it is. What is
  // left keeps its order, and the batch counts no triangles of transition cells afterwards.
  void drop(const glm::mat3& to_space, float distance, MeshBatch& batch);

 private:
  void join(const MeshBatch& batch);
  std::uint32_t rootOf(std::uint32_t vertex);
  void measure(const glm::mat3& to_space, const MeshBatch& batch);

  struct Box {
    glm::vec3 lower, upper;
  };
  std::vector<std::uint32_t> parents_;  // of vertices; a root is its own
  std::vector<Box> boxes_;              // of roots
  std::vector<std::uint8_t> is_small_;  // of roots
};

// Takes vertices away that no triangle has; the others keep their order. `numbers` is memory.
void dropUnusedVertices(MeshBatch& batch, std::vector<std::uint32_t>& numbers);

}  // namespace isobrick
