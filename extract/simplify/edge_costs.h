// The costs of collapsing edges, some at a time.
#pragma once

#include <array>
#include <cstddef>
#include <glm/vec3.hpp>

#include "isobrick/extract/simplify/quadric.h"

namespace isobrick {

// How much a vertex is drawn to the middle of its edge, in weights of its triangles.
inline constexpr float kPull = 1e-3f;

// The place at which the sum of squared distances is least for the vertex that remains of an edge,
// relative to the end that stays. `sum`: about that end; `to_gone`: from there to the other one.
inline glm::vec3 bestPlace(const Quadric& sum, const glm::vec3& to_gone) {
  return sum.leastNear(0.5f * to_gone, kPull * sum.weight);
}

// Edges in columns, so that the compiler computes several of them with each instruction.
class EdgeBlock {
 public:
  static constexpr std::size_t kEdges = 16;

  // `to_gone`: from the end that stays to the one that goes. A fixed end stays where it is.
  void set(std::size_t i, const Quadric& gone, const Quadric& kept, const glm::vec3& to_gone,
           bool is_fixed) {
    put(gone_, i, gone);
    put(kept_, i, kept);
    for (int axis = 0; axis < 3; ++axis)
      to_gone_[static_cast<std::size_t>(axis)][i] = to_gone[axis];
    is_free_[i] = is_fixed ? 0.0f : 1.0f;
  }
  // Sets cost() and weight() of all edges; those that were never set have no meaning.
  void compute();
  // The sum of squared distances, by area, of what remains of the edge; and the area.
  float cost(std::size_t i) const { return costs_[i]; }
  float weight(std::size_t i) const { return weights_[i]; }

 private:
  using Column = std::array<float, kEdges>;
  using Columns = std::array<Column, 11>;
  static void put(Columns& columns, std::size_t i, const Quadric& q) {
    const float values[] = {q.xx, q.yy, q.zz, q.xy, q.yz, q.zx, q.b.x, q.b.y, q.b.z, q.c, q.weight};
    for (std::size_t k = 0; k < columns.size(); ++k) columns[k][i] = values[k];
  }
  static Quadric get(const Columns& c, std::size_t i) {
    return {c[0][i], c[1][i], c[2][i], c[3][i], c[4][i], c[5][i], {c[6][i], c[7][i], c[8][i]},
            c[9][i], c[10][i]};
  }

  alignas(64) Columns gone_{}, kept_{};
  alignas(64) std::array<Column, 3> to_gone_{};
  alignas(64) Column is_free_{}, costs_{}, weights_{};
};

inline void EdgeBlock::compute() {
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
