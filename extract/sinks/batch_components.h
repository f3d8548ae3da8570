// The connected components of one batch.
#pragma once

#include <algorithm>
#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// The least number of the set of `number`: its root, which is its own parent. `parents` has an
// entry for every number, at most the number itself; at first each number is a set. Every number on
// the way gets its grandparent as its parent, so that ways stay short.
inline std::uint32_t rootOf(std::vector<std::uint32_t>& parents, std::uint32_t number) {
  while (parents[number] != number) {
    parents[number] = parents[parents[number]];
    number = parents[number];
  }
  return number;
}

// Makes one set of those of `a` and `b`.
inline void joinSets(std::vector<std::uint32_t>& parents, std::uint32_t a, std::uint32_t b) {
  a = rootOf(parents, a);
  b = rootOf(parents, b);
  parents[std::max(a, b)] = std::min(a, b);
}

// The number of a vertex that is there no longer.
inline constexpr std::uint32_t kDroppedVertex = ~std::uint32_t{0};

// Gives every vertex of the batch the number of its component, 0, 1, ... in the order of their
// first vertices; returns how many there are. Vertices that triangles of this batch join belong
// together.
std::uint32_t labelComponents(const MeshBatch& batch, std::vector<std::uint32_t>& labels);

// Keeps the triangles of those components for which `is_kept` is not 0, and their vertices, in
// their order. `labels`: of labelComponents(). False: all stay, and nothing changes. Otherwise the
// batch counts no triangles of transition cells afterwards, and `labels` has the new number of
// every vertex, or kDroppedVertex.
bool keepComponents(MeshBatch& batch, std::vector<std::uint32_t>& labels,
                    const std::vector<std::uint8_t>& is_kept);

// Takes vertices away that no triangle has; the others keep their order. `numbers` gets the new
// number of every vertex, or kDroppedVertex.
void dropUnusedVertices(MeshBatch& batch, std::vector<std::uint32_t>& numbers);

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
