#include "isobrick/extract/sinks/batch_components.h"

#include <numeric>

#include "isobrick/extract/sinks/disjoint_sets.h"

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
  std::size_t kept = 0;
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
    if (is_kept[labels[batch.triangles[i]]] == 0) continue;
    for (std::size_t corner = 0; corner < 3; ++corner)
      batch.triangles[kept++] = batch.triangles[i + corner];
  }
  if (kept == batch.triangles.size()) return false;
  batch.triangles.resize(kept);
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

}  // namespace isobrick
