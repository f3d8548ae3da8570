#include "tests/support/crossing_triangles.h"

#include <algorithm>
#include <boost/multiprecision/cpp_int.hpp>
#include <cmath>
#include <glm/common.hpp>
#include <optional>

namespace isobrick::test {
namespace {

using Rational = boost::multiprecision::cpp_rational;
using Corners = std::array<std::uint32_t, 3>;

// (b - a) x (c - a) . (d - a)
template <typename Number>
Number volume(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c, const glm::dvec3& d) {
  const auto along = [&](const glm::dvec3& to, int axis) -> Number {
    return Number(to[axis]) - Number(a[axis]);
  };
  const Number bx = along(b, 0), by = along(b, 1), bz = along(b, 2);
  const Number cx = along(c, 0), cy = along(c, 1), cz = along(c, 2);
  const Number dx = along(d, 0), dy = along(d, 1), dz = along(d, 2);
  return bx * (cy * dz - cz * dy) + by * (cz * dx - cx * dz) + bz * (cx * dy - cy * dx);
}

double greatestDifference(const glm::dvec3& a, const glm::dvec3& b) {
  const glm::dvec3 d = glm::abs(b - a);
  return std::max({d.x, d.y, d.z});
}

template <typename Number>
int signOf(const Number& number) {
  return (number > 0) - (number < 0);
}

// From one point to a nearby one, both on the grid of crossings, of which many lie in one plane: in
// steps of it.
std::optional<glm::i64vec3> stepsOnGrid(const glm::dvec3& from, const glm::dvec3& to) {
  constexpr double kSteps = 32768, kMost = 1 << 20;
  const glm::dvec3 steps = (to - from) * kSteps;
  if (steps != glm::floor(steps) || greatestDifference(steps, glm::dvec3(0)) > kMost)
    return std::nullopt;
  return glm::i64vec3(steps);
}

// Which side of the plane through a, b and c has d.
int sideOf(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c, const glm::dvec3& d) {
  const auto fast = volume<double>(a, b, c, d);
  // Above all roundings of six products of three differences.
  const double bound =
      1e-14 * greatestDifference(a, b) * greatestDifference(a, c) * greatestDifference(a, d);
  if (std::abs(fast) > bound && bound > 1e-280) return signOf(fast);
  const auto x = stepsOnGrid(a, b), y = stepsOnGrid(a, c), z = stepsOnGrid(a, d);
  if (x && y && z)
    return signOf(x->x * (y->y * z->z - y->z * z->y) + x->y * (y->z * z->x - y->x * z->z) +
                  x->z * (y->x * z->y - y->y * z->x));
  return signOf(volume<Rational>(a, b, c, d));
}

// The same in a plane of two axes: the way round of a, b and c.
struct Plane {
  int u, v;

  int turn(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) const {
    const auto difference = [&](const glm::dvec3& to, int axis) -> Rational {
      return Rational(to[axis]) - Rational(a[axis]);
    };
    const double left = (b[u] - a[u]) * (c[v] - a[v]), right = (b[v] - a[v]) * (c[u] - a[u]);
    if (std::abs(left - right) > 1e-14 * (std::abs(left) + std::abs(right)) + 1e-280)
      return signOf(left - right);
    if (const auto x = stepsOnGrid(a, b), y = stepsOnGrid(a, c); x && y)
      return signOf((*x)[u] * (*y)[v] - (*x)[v] * (*y)[u]);
    return signOf<Rational>(difference(b, u) * difference(c, v) -
                            difference(b, v) * difference(c, u));
  }
  bool isBetween(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& p) const {
    return std::min(a[u], b[u]) <= p[u] && p[u] <= std::max(a[u], b[u]) &&
           std::min(a[v], b[v]) <= p[v] && p[v] <= std::max(a[v], b[v]);
  }
  bool haveCommonPoint(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c,
                       const glm::dvec3& d) const {
    const int at_c = turn(a, b, c), at_d = turn(a, b, d);
    const int at_a = turn(c, d, a), at_b = turn(c, d, b);
    if (at_c * at_d < 0 && at_a * at_b < 0) return true;
    return (at_c == 0 && isBetween(a, b, c)) || (at_d == 0 && isBetween(a, b, d)) ||
           (at_a == 0 && isBetween(c, d, a)) || (at_b == 0 && isBetween(c, d, b));
  }
};

// One onto which a triangle projects with an area; it has none if u is below 0.
Plane planeOf(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
  for (int axis = 0; axis < 3; ++axis)
    if (const Plane plane{(axis + 1) % 3, (axis + 2) % 3}; plane.turn(a, b, c) != 0) return plane;
  return {-1, -1};
}

bool areOneWay(int a, int b, int c) {
  return (a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0);
}

// Of the segment from p to q and a triangle with an area, ends and sides included.
bool haveCommonPoint(const glm::dvec3& p, const glm::dvec3& q, const glm::dvec3& a,
                     const glm::dvec3& b, const glm::dvec3& c) {
  const int at_p = sideOf(a, b, c, p), at_q = sideOf(a, b, c, q);
  if (at_p * at_q > 0) return false;
  if (at_p != 0 || at_q != 0)
    return areOneWay(sideOf(p, q, a, b), sideOf(p, q, b, c), sideOf(p, q, c, a));
  const Plane plane = planeOf(a, b, c);
  return areOneWay(plane.turn(a, b, p), plane.turn(b, c, p), plane.turn(c, a, p)) ||
         plane.haveCommonPoint(p, q, a, b) || plane.haveCommonPoint(p, q, b, c) ||
         plane.haveCommonPoint(p, q, c, a);
}

class Mesh {
 public:
  Mesh(std::span<const glm::dvec3> positions, std::span<const std::uint32_t> triangles)
      : positions_(positions), triangles_(triangles) {}

  std::size_t size() const { return triangles_.size() / 3; }
  Corners corners(std::size_t triangle) const {
    return {triangles_[3 * triangle], triangles_[3 * triangle + 1], triangles_[3 * triangle + 2]};
  }
  const glm::dvec3& at(std::uint32_t vertex) const { return positions_[vertex]; }
  bool hasArea(std::size_t triangle) const {
    const auto [a, b, c] = corners(triangle);
    return planeOf(at(a), at(b), at(c)).u >= 0;
  }

  // Beside what they share. Both have areas.
  bool cross(std::size_t first, std::size_t second) const {
    Corners a = corners(first), b = corners(second);
    // The shared ones come first in both, in the same order.
    std::size_t shared = 0;
    for (std::size_t i = 0; i < 3; ++i)
      if (const auto found =
              std::find(b.begin() + static_cast<std::ptrdiff_t>(shared), b.end(), a[i]);
          found != b.end()) {
        std::swap(*found, b[shared]);
        std::swap(a[i], a[shared++]);
      }
    if (shared == 3) return true;
    if (shared == 2) return foldBack(at(a[0]), at(a[1]), at(a[2]), at(b[2]));
    // As a rule one lies on one side of the other's plane.
    if (isBeside(a, b, shared) || isBeside(b, a, shared)) return false;
    if (shared == 1) return meets(a[1], a[2], b) || meets(b[1], b[2], a);
    for (std::size_t i = 0; i < 3; ++i)
      if (meets(a[i], a[(i + 1) % 3], b) || meets(b[i], b[(i + 1) % 3], a)) return true;
    return false;
  }

 private:
  bool isBeside(const Corners& one, const Corners& other, std::size_t shared) const {
    int sides = 0;
    for (std::size_t i = shared; i < 3; ++i)
      sides += sideOf(at(one[0]), at(one[1]), at(one[2]), at(other[i]));
    return std::abs(sides) == 3 - static_cast<int>(shared);
  }
  bool meets(std::uint32_t p, std::uint32_t q, const Corners& triangle) const {
    return haveCommonPoint(at(p), at(q), at(triangle[0]), at(triangle[1]), at(triangle[2]));
  }
  // Two triangles on both sides of an edge lie on each other.
  static bool foldBack(const glm::dvec3& from, const glm::dvec3& to, const glm::dvec3& a,
                       const glm::dvec3& b) {
    if (sideOf(from, to, a, b) != 0) return false;
    const Plane plane = planeOf(from, to, a);
    return plane.turn(from, to, a) == plane.turn(from, to, b);
  }

  std::span<const glm::dvec3> positions_;
  std::span<const std::uint32_t> triangles_;
};

}  // namespace

std::vector<TrianglePair> crossingTriangles(std::span<const glm::dvec3> positions,
                                            std::span<const std::uint32_t> triangles) {
  struct Box {
    glm::dvec3 lower, upper;
    std::size_t triangle;
  };
  const Mesh mesh(positions, triangles);
  std::vector<TrianglePair> pairs;
  std::vector<Box> boxes;
  for (std::size_t t = 0; t < mesh.size(); ++t) {
    const auto [a, b, c] = mesh.corners(t);
    if (mesh.hasArea(t))
      boxes.push_back({glm::min(glm::min(mesh.at(a), mesh.at(b)), mesh.at(c)),
                       glm::max(glm::max(mesh.at(a), mesh.at(b)), mesh.at(c)), t});
    else
      pairs.push_back({t, t});
  }
  std::sort(boxes.begin(), boxes.end(), [](const Box& a, const Box& b) {
    return a.lower.x != b.lower.x ? a.lower.x < b.lower.x : a.triangle < b.triangle;
  });
  for (std::size_t i = 0; i < boxes.size(); ++i)
    for (std::size_t j = i + 1; j < boxes.size() && boxes[j].lower.x <= boxes[i].upper.x; ++j) {
      const Box &a = boxes[i], &b = boxes[j];
      if (a.lower.y > b.upper.y || b.lower.y > a.upper.y || a.lower.z > b.upper.z ||
          b.lower.z > a.upper.z)
        continue;
      if (mesh.cross(a.triangle, b.triangle)) pairs.push_back({a.triangle, b.triangle});
    }
  return pairs;
}

}  // namespace isobrick::test
