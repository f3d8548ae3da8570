#include "isobrick/extract/simplify/small_components.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>

#include "isobrick/extract/sinks/batch_components.h"

namespace isobrick {

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
