#include "preprocess/node_ranges.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "storage/voxel_type.h"

namespace isobrick {
namespace {

// Includes all samples of `level` in the closed cube of node `node` of level `node_level`.
template <typename T>
void includeSamples(const Lattice& lattice, const std::vector<T>& samples, int level,
                    int node_level, const Index3& node, ValueRange& range) {
  const Index3 dims = lattice.samples(level);
  const std::int64_t edge = std::int64_t{1} << (node_level - level);
  const Index3 first = node * edge;
  const Index3 last = glm::min(first + Index3(edge), dims - Index3(1));
  T least = samples[static_cast<std::size_t>(linearIndex(first, dims))];
  T greatest = least;
  for (std::int64_t z = first.z; z <= last.z; ++z)
    for (std::int64_t y = first.y; y <= last.y; ++y) {
      const T* row = samples.data() + (z * dims.y + y) * dims.x;
      for (std::int64_t x = first.x; x <= last.x; ++x) {
        least = std::min(least, row[x]);
        greatest = std::max(greatest, row[x]);
      }
    }
  range.include(static_cast<float>(least));
  range.include(static_cast<float>(greatest));
}

// Calls `f(node, range)` for all nodes of a level, slices of nodes in parallel.
template <typename F>
NodeRanges forAllNodes(const Index3& dims, F&& f) {
  NodeRanges result{dims, std::vector<ValueRange>(static_cast<std::size_t>(elementCount(dims)))};
  tbb::parallel_for(std::int64_t{0}, dims.z * dims.y, [&](std::int64_t row) {
    Index3 node{0, row % dims.y, row / dims.y};
    for (; node.x < dims.x; ++node.x)
      f(node, result.ranges[static_cast<std::size_t>(linearIndex(node, dims))]);
  });
  return result;
}

}  // namespace

template <typename T>
NodeRanges nodeRangesFromSamples(const Lattice& lattice, const LevelArrays<T>& levels,
                                 int node_level) {
  return forAllNodes(lattice.cells(node_level), [&](const Index3& node, ValueRange& range) {
    for (int level = 0; level <= std::min(node_level, lattice.levels() - 1); ++level)
      includeSamples(lattice, levels[static_cast<std::size_t>(level)], level, node_level, node,
                     range);
  });
}

template <typename T>
NodeRanges coarserNodeRanges(const Lattice& lattice, const LevelArrays<T>& levels,
                             const NodeRanges& children, int node_level) {
  return forAllNodes(lattice.cells(node_level), [&](const Index3& node, ValueRange& range) {
    const Index3 last = glm::min(2L * node + Index3(1), children.dims - Index3(1));
    Index3 child;
    for (child.z = 2 * node.z; child.z <= last.z; ++child.z)
      for (child.y = 2 * node.y; child.y <= last.y; ++child.y)
        for (child.x = 2 * node.x; child.x <= last.x; ++child.x) range.include(children.at(child));
    if (node_level < lattice.levels())
      includeSamples(lattice, levels[static_cast<std::size_t>(node_level)], node_level, node_level,
                     node, range);
  });
}

#define ISOBRICK_INSTANTIATE(T)                                                             \
  template NodeRanges nodeRangesFromSamples<T>(const Lattice&, const LevelArrays<T>&, int); \
  template NodeRanges coarserNodeRanges<T>(const Lattice&, const LevelArrays<T>&,           \
                                           const NodeRanges&, int);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
