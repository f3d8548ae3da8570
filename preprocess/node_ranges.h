// Value ranges of octree nodes as closures over all levels that meshing may read (rule 7).
#pragma once

#include <vector>

#include "storage/brick_layout.h"
#include "storage/value_range.h"

namespace isobrick {

// The samples of all levels of a volume, level 0 first, each x fastest.
template <typename T>
using LevelArrays = std::vector<std::vector<T>>;

// Ranges of all nodes of one octree level.
struct NodeRanges {
  Index3 dims{0};
  std::vector<ValueRange> ranges;  // x fastest

  const ValueRange& at(const Index3& node) const {
    return ranges[static_cast<std::size_t>(linearIndex(node, dims))];
  }
};

// Ranges of the nodes of level `node_level` from the samples themselves: every sample of the levels
// 0 .. node_level (as far as the pyramid has them) in the node's closed cube. TBB-parallel.
template <typename T>
NodeRanges nodeRangesFromSamples(const Lattice& lattice, const LevelArrays<T>& levels,
                                 int node_level);

// The next coarser nodes: the union of the children and of the samples of the node's own level at
// its corners, where the pyramid has that level. TBB-parallel.
template <typename T>
NodeRanges coarserNodeRanges(const Lattice& lattice, const LevelArrays<T>& levels,
                             const NodeRanges& children, int node_level);

}  // namespace isobrick
