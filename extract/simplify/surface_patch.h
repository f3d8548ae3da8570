// A piece of a surface: triangles, what is beside them, and where they lie.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace isobrick {

// Triangles over positions that somebody else keeps; the memory goes round from patch to patch.
// Numbers of triangles and corners are those of `triangles`.
class SurfacePatch {
 public:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};

  // The side of a plane: positive values of valueAt() lie beyond it.
  struct Plane {
    glm::vec3 normal{0.0f};  // all zero: nothing lies beyond
    float offset = 0;
    float valueAt(const glm::vec3& point) const {
      return normal.x * point.x + normal.y * point.y + normal.z * point.z - offset;
    }
  };
  // Where a triangle lies. Side s is the edge from corner s to the next.
  struct Facet {
    std::array<glm::vec3, 3> corners;
    glm::vec3 normal;  // unit; zero if the triangle has no area
    // Through each side, along the mean of the normals of both triangles there: what lies beyond
    // is nearer to the other one. None at a border.
    std::array<Plane, 3> sides;
  };

  // Takes over the triangles: three indices of positions each, none of them twice in one triangle.
  void set(std::span<const std::uint32_t> triangles, std::size_t positions);
  // Places the facets; again if positions have moved.
  void place(std::span<const glm::vec3> positions);

  std::uint32_t count() const { return static_cast<std::uint32_t>(triangles_.size() / 3); }
  std::span<const std::uint32_t> triangles() const { return triangles_; }
  const std::uint32_t* triangle(std::uint32_t t) const { return &triangles_[std::size_t{3} * t]; }
  // The triangles that have a vertex.
  std::span<const std::uint32_t> around(std::uint32_t vertex) const {
    return std::span(around_).subspan(first_around_[vertex],
                                      first_around_[vertex + 1] - first_around_[vertex]);
  }
  // The triangle beyond a side; kNone at a border, and if more than one is there.
  std::uint32_t beside(std::uint32_t t, int side) const {
    return beside_[std::size_t{3} * t + static_cast<std::size_t>(side)];
  }
  // Whether any triangle has both vertices, and whether one has the three in this direction.
  bool hasSide(std::uint32_t a, std::uint32_t b) const;
  bool hasTriangle(const std::uint32_t* corners) const;
  // Vertices at which this is no surface: corners of sides that more than two triangles have, or
  // two in the same direction, and of triangles back to back; vertices of more than one fan.
  std::span<const std::uint32_t> faults() const { return faults_; }
  const Facet& facet(std::uint32_t t) const { return facets_[t]; }

 private:
  void findNeighbours();
  void findPinches();

  std::vector<std::uint32_t> triangles_;
  std::vector<std::uint32_t> first_around_, around_;  // of each vertex
  std::vector<std::uint32_t> beside_;
  std::vector<std::uint32_t> faults_;
  std::vector<Facet> facets_;
};

}  // namespace isobrick
