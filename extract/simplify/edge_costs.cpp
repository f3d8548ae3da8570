#include "isobrick/extract/simplify/edge_costs.h"

#include <algorithm>

namespace isobrick {

void EdgeBlock::compute() {
  for (std::size_t i = 0; i < kEdges; ++i) {
    const glm::vec3 to_gone(to_gone_[0][i], to_gone_[1][i], to_gone_[2][i]);
    Quadric sum = get(gone_, i);
    sum.moveCenter(-to_gone);
    sum += get(kept_, i);
    const float value = sum.valueAt(is_free_[i] * bestPlace(sum, to_gone));
    costs_[i] = value > 0 ? value : 0.0f;
    weights_[i] = sum.weight;
  }
}

}  // namespace isobrick
