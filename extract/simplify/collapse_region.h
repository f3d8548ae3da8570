// Triangles whose inner vertices become one.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>

#include "isobrick/extract/simplify/corner_table.h"

namespace isobrick {

// A disc of old triangles, and the fan of new ones that takes its place when all vertices inside of
// its ring become one: both ends of an edge, or a vertex and its neighbours, a star.
//
// Points have numbers: 0 and on are the ring, counter-clockwise; kFirstInner and on are inside. Old
// triangle i has ring points i and i + 1 and an inner one, for i below sides(); those that vanish
// follow. New triangle i has ring points i and i + 1 as well. If the ring is open, the second inner
// vertex stays where it is: the ring begins and ends beside it, and the triangles on its other side
// stay as well. At the surface's border it begins or ends there.
//
// Functions that find a region return false if it would be too large or would leave no surface.
// Inner vertices must have closed rings of triangles, but for one that stays.
struct CollapseRegion {
  static constexpr int kMostRing = 28, kMostInner = 10, kMostTriangles = 48, kMostEdges = 64;
  // With room to compute four points at once.
  static constexpr int kFirstInner = kMostRing, kMostPoints = kMostRing + kMostInner + 2;

  struct Triangle {
    std::uint8_t a, b, c;  // points, counter-clockwise
  };
  // A side inside of the ring: from an inner point to any other, and the old triangles at it.
  struct Edge {
    std::uint8_t from, to, triangle, other;
  };

  int ring = 0, inner = 0, triangles = 0, edges = 0;  // how many
  bool is_open = false;
  // Of a vertex of the surface's border: the ring point at the other end of the new side of the
  // border, on which the vertex lies. Otherwise -1.
  int border_point = -1;
  glm::vec3 shift{0.0f};                            // that brought it there; the caller sets it
  std::array<std::uint32_t, kMostPoints> vertices;  // of points
  std::array<Triangle, kMostTriangles> old;         // triangles
  std::array<std::uint32_t, kMostTriangles>
      corners;                           // of old triangles, one each at an inner point
  std::array<Edge, kMostEdges> between;  // old triangles
  // Of points, relative to the new place; an axis in each array. The caller sets them.
  alignas(16) std::array<std::array<float, kMostPoints>, 3> places;

  int sides() const { return is_open ? ring - 1 : ring; }
  int before(int i) const { return i == 0 ? ring - 1 : i - 1; }
  void setPlace(int point, const glm::vec3& place) {
    for (int axis = 0; axis < 3; ++axis) places[axis][point] = place[axis];
  }

  // An edge from the corner's vertex, the first inner one, to that of the next corner.
  bool findEdge(const CornerTable& table, std::uint32_t corner, bool end_stays);
  // A vertex of the surface's border becomes its first or its last neighbour, counter-clockwise.
  // `corner`: of the vertex, in the first triangle.
  bool findBorder(const CornerTable& table, std::uint32_t corner, bool becomes_first);
  // The corner's vertex, the first inner one, and its neighbours; then all that is around them.
  bool findStar(const CornerTable& table, std::uint32_t corner);
  bool findAroundStar(const CornerTable& table);

  // The fan around a vertex takes the place of the old triangles.
  void replace(CornerTable& table, std::uint32_t vertex) const;

 private:
  bool addRingPoint(std::uint32_t vertex);
  bool addSides(const CornerTable& table, int point, std::uint32_t from, std::uint32_t end);
  void closeRing();
  void addTriangle(int a, int b, int c, std::uint32_t corner);
  void addEdge(int from, int to, int triangle, int other);

  std::array<std::uint32_t, kMostInner> spokes_;  // of a star: corners of its center
};

}  // namespace isobrick
