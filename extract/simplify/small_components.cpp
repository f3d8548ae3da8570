#include "isobrick/extract/simplify/small_components.h"

#include <algorithm>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <numeric>

namespace isobrick {

void SmallComponents::drop(const glm::mat3& to_space, float distance, MeshBatch& batch) {
  join(batch);
  measure(to_space, batch);
  is_small_.assign(parents_.size(), 0);
  for (std::size_t v = 0; v < parents_.size(); ++v) {
    const glm::vec3 extent = boxes_[v].upper - boxes_[v].lower;
    is_small_[v] = parents_[v] == v && glm::dot(extent, extent) < distance * distance;
  }
  for (const MeshBatch::SharedVertex& shared : batch.shared) is_small_[rootOf(shared.vertex)] = 0;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
    if (is_small_[rootOf(batch.triangles[i])] != 0) continue;
    for (std::size_t corner = 0; corner < 3; ++corner)
      batch.triangles[kept++] = batch.triangles[i + corner];
  }
  if (kept == batch.triangles.size()) return;
  batch.triangles.resize(kept);
  batch.transition_indices = 0;
  dropUnusedVertices(batch, parents_);
}

// The vertices of a triangle belong together. The least vertex of a component is its root.
void SmallComponents::join(const MeshBatch& batch) {
  parents_.resize(batch.positions.size());
  std::iota(parents_.begin(), parents_.end(), 0u);
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3)
    for (std::size_t corner = 1; corner < 3; ++corner) {
      const std::uint32_t a = rootOf(batch.triangles[i]), b = rootOf(batch.triangles[i + corner]);
      parents_[std::max(a, b)] = std::min(a, b);
    }
}

// Every vertex on the way gets its grandparent as its parent, so that ways stay short.
std::uint32_t SmallComponents::rootOf(std::uint32_t vertex) {
  while (parents_[vertex] != vertex) {
    parents_[vertex] = parents_[parents_[vertex]];
    vertex = parents_[vertex];
  }
  return vertex;
}

void SmallComponents::measure(const glm::mat3& to_space, const MeshBatch& batch) {
  constexpr float kFar = std::numeric_limits<float>::max();
  boxes_.assign(parents_.size(), {glm::vec3(kFar), glm::vec3(-kFar)});
  for (std::uint32_t v = 0; v < parents_.size(); ++v) {
    const glm::vec3 at = to_space * batch.positions[v];
    Box& box = boxes_[rootOf(v)];
    box.lower = glm::min(box.lower, at);
    box.upper = glm::max(box.upper, at);
  }
}

void dropUnusedVertices(MeshBatch& batch, std::vector<std::uint32_t>& numbers) {
  constexpr std::uint32_t kUnused = ~std::uint32_t{0};
  numbers.assign(batch.positions.size(), kUnused);
  for (const std::uint32_t vertex : batch.triangles) numbers[vertex] = 0;
  std::uint32_t count = 0;
  for (std::uint32_t v = 0; v < numbers.size(); ++v) {
    if (numbers[v] == kUnused) continue;
    numbers[v] = count;
    batch.positions[count] = batch.positions[v];
    batch.normals[count++] = batch.normals[v];
  }
  batch.positions.resize(count);
  batch.normals.resize(count);
  for (std::uint32_t& vertex : batch.triangles) vertex = numbers[vertex];
  std::erase_if(batch.shared, [&](const auto& s) { return numbers[s.vertex] == kUnused; });
  for (MeshBatch::SharedVertex& shared : batch.shared) shared.vertex = numbers[shared.vertex];
}

}  // namespace isobrick
