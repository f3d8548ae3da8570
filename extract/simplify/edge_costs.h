// The costs of collapsing edges, some at a time.
#pragma once

#include <array>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

namespace isobrick {

// The weighted sum of squared distances of a point to some planes, as a function of the point
// relative to a centre that the owner knows: near the centre, floats are enough.
struct Quadric {
  float xx = 0, yy = 0, zz = 0, xy = 0, yz = 0, zx = 0;  // the matrix A
  glm::vec3 b{0.0f};
  float c = 0;
  float weight = 0;  // of all planes

  // The plane through the centre with a unit normal.
  void addPlane(const glm::vec3& n, float w) {
    xx += w * n.x * n.x;
    yy += w * n.y * n.y;
    zz += w * n.z * n.z;
    xy += w * n.x * n.y;
    yz += w * n.y * n.z;
    zx += w * n.z * n.x;
    weight += w;
  }
  glm::vec3 times(const glm::vec3& p) const {
    return {xx * p.x + xy * p.y + zx * p.z, xy * p.x + yy * p.y + yz * p.z,
            zx * p.x + yz * p.y + zz * p.z};
  }
  float valueAt(const glm::vec3& p) const { return glm::dot(p, times(p) + 2.0f * b) + c; }
  // About a centre that lies `by` from the present one.
  void moveCenter(const glm::vec3& by) {
    const glm::vec3 moved = b + times(by);
    c += glm::dot(by, b + moved);
    b = moved;
  }
  Quadric& operator+=(const Quadric& other) {
    xx += other.xx;
    yy += other.yy;
    zz += other.zz;
    xy += other.xy;
    yz += other.yz;
    zx += other.zx;
    b += other.b;
    c += other.c;
    weight += other.weight;
    return *this;
  }
  // The place of the least sum if the squared distance to `near` counts as well, times `pull`,
  // above 0: without it any place on a line or a plane may be as good as any other.
  glm::vec3 leastNear(const glm::vec3& near, float pull) const {
    const float ax = xx + pull, ay = yy + pull, az = zz + pull;
    const glm::vec3 right = pull * near - b;
    const float cxx = ay * az - yz * yz, cxy = zx * yz - xy * az, czx = xy * yz - zx * ay;
    const float cyy = ax * az - zx * zx, cyz = xy * zx - ax * yz, czz = ax * ay - xy * xy;
    const float determinant = ax * cxx + xy * cxy + zx * czx;
    return glm::vec3(cxx * right.x + cxy * right.y + czx * right.z,
                     cxy * right.x + cyy * right.y + cyz * right.z,
                     czx * right.x + cyz * right.y + czz * right.z) /
           determinant;
  }
};

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
