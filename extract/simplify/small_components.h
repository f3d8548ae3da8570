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
  // with a vertex that other batches may have stays, since its size is not known here.
  void drop(const glm::mat3& to_space, float distance, MeshBatch& batch);

 private:
  struct Box {
    glm::vec3 lower, upper;
  };
  std::vector<std::uint32_t> labels_;  // of vertices
  std::vector<Box> boxes_;             // of components
  std::vector<std::uint8_t> is_kept_;  // likewise
};

}  // namespace isobrick
