// Triangles of one batch that pass through each other.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace isobrick {

// Finds them in exact arithmetic, with memory that is reused.
class SelfCrossings {
 public:
  // Of positions: they are whole numbers up to this in magnitude.
  static constexpr std::int32_t kMostCoordinate = 1 << 25;
  using Triangle = std::array<std::uint32_t, 3>;  // vertices

  // Those that have a point in common with another one beside the vertices, or the edge, that both
  // have; and those without area. Ascending; valid until the next call.
  std::span<const std::uint32_t> find(std::span<const glm::ivec3> positions,
                                      std::span<const Triangle> triangles);

 private:
  struct Box {
    glm::ivec3 lower, upper;
  };

  void putInCells(const glm::ivec3& lower, const glm::ivec3& upper);
  glm::ivec3 cellOf(const glm::ivec3& position) const;
  std::size_t cellNumber(const glm::ivec3& cell) const {
    return static_cast<std::size_t>((cell.z * cells_ + cell.y) * cells_ + cell.x);
  }
  template <typename F>
  void forEachCellOf(const Box& box, const F& visit) const;

  std::vector<Box> boxes_;  // of triangles
  // The box of all, cut in so many cells along each axis; a cell's triangles are those of
  // in_cells_ from its number of first_ on.
  std::int32_t cells_ = 1, cell_size_ = 1;
  glm::ivec3 origin_{0};
  std::vector<std::uint32_t> first_, in_cells_;
  std::vector<std::uint32_t> found_;
};

}  // namespace isobrick
