#include "isobrick/extract/sinks/batch_components.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <numeric>

namespace isobrick {

std::uint32_t labelComponents(const MeshBatch& batch, std::vector<std::uint32_t>& labels) {
  labels.resize(batch.positions.size());
  std::iota(labels.begin(), labels.end(), 0u);
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3)
    for (std::size_t corner = 1; corner < 3; ++corner)
      joinSets(labels, batch.triangles[i], batch.triangles[i + corner]);
  // Parents come before their children, so a parent has its label already.
  std::uint32_t count = 0;
  for (std::uint32_t v = 0; v < labels.size(); ++v)
    labels[v] = labels[v] == v ? count++ : labels[labels[v]];
  return count;
}

bool keepComponents(MeshBatch& batch, std::vector<std::uint32_t>& labels,
                    const std::vector<std::uint8_t>& is_kept) {
  const std::size_t first_cap = batch.triangles.size() - batch.cap_indices;
  std::size_t kept = 0, kept_caps = 0;
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
    if (is_kept[labels[batch.triangles[i]]] == 0) continue;
    kept_caps += i >= first_cap ? 3 : 0;
    for (std::size_t corner = 0; corner < 3; ++corner)
      batch.triangles[kept++] = batch.triangles[i + corner];
  }
  if (kept == batch.triangles.size()) return false;
  batch.triangles.resize(kept);
  batch.cap_indices = kept_caps;
  batch.transition_indices = 0;
  dropUnusedVertices(batch, labels);
  return true;
}

void dropUnusedVertices(MeshBatch& batch, std::vector<std::uint32_t>& numbers) {
  numbers.assign(batch.positions.size(), kDroppedVertex);
  for (const std::uint32_t vertex : batch.triangles) numbers[vertex] = 0;
  std::uint32_t count = 0;
  for (std::uint32_t v = 0; v < numbers.size(); ++v) {
    if (numbers[v] == kDroppedVertex) continue;
    numbers[v] = count;
    batch.positions[count] = batch.positions[v];
    batch.normals[count++] = batch.normals[v];
  }
  batch.positions.resize(count);
  batch.normals.resize(count);
  for (std::uint32_t& vertex : batch.triangles) vertex = numbers[vertex];
  std::erase_if(batch.shared, [&](const auto& s) { return numbers[s.vertex] == kDroppedVertex; });
  for (MeshBatch::SharedVertex& shared : batch.shared) shared.vertex = numbers[shared.vertex];
}

void SmallComponents::drop(const glm::mat3& to_space, float distance, MeshBatch& batch) {
  constexpr float kFar = std::numeric_limits<float>::max();
  boxes_.assign(labelComponents(batch, labels_), {glm::vec3(kFar), glm::vec3(-kFar)});
  for (std::size_t v = 0; v < labels_.size(); ++v) {
    const glm::vec3 at = to_space * batch.positions[v];
    Box& box = boxes_[labels_[v]];
    box.lower = glm::min(box.lower, at);
    box.upper = glm::max(box.upper, at);
  }
  is_kept_.resize(boxes_.size());
  for (std::size_t i = 0; i < boxes_.size(); ++i) {
    const glm::vec3 extent = boxes_[i].upper - boxes_[i].lower;
    is_kept_[i] = glm::dot(extent, extent) >= distance * distance;
  }
  for (const MeshBatch::SharedVertex& shared : batch.shared) is_kept_[labels_[shared.vertex]] = 1;
  keepComponents(batch, labels_, is_kept_);
}

}  // namespace isobrick
