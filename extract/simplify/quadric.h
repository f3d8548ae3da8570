// Squared distances to planes, summed (Garland and Heckbert 1997).
#pragma once

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

}  // namespace isobrick
