// The connected components of a mesh in memory.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <numeric>
#include <vector>

#include "isobrick/extract/sinks/indexed_mesh.h"

namespace isobrick::test {

// Triangles of each component, the most first.
inline std::vector<std::uint64_t> trianglesOfComponents(const IndexedMesh& mesh) {
  std::vector<std::uint32_t> parents(mesh.positions.size());
  std::iota(parents.begin(), parents.end(), 0u);
  const auto rootOf = [&](std::uint32_t v) {
    while (parents[v] != v) v = parents[v] = parents[parents[v]];
    return v;
  };
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    parents[rootOf(mesh.triangles[i])] = rootOf(mesh.triangles[i - i % 3]);
  std::map<std::uint32_t, std::uint64_t> counts;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) ++counts[rootOf(mesh.triangles[i])];
  std::vector<std::uint64_t> sorted;
  for (const auto& [root, count] : counts) sorted.push_back(count);
  std::ranges::sort(sorted, std::greater());
  return sorted;
}

}  // namespace isobrick::test
