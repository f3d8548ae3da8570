// The connected components of one batch.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

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

}  // namespace isobrick
