// Triangles and what is beside them, while edges collapse.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace isobrick {

// A table of corners (Rossignac 2001): triangle t has the corners 4t, 4t + 1 and 4t + 2, and each
// corner knows its vertex and the corner that faces it across the side between the other two.
class CornerTable {
 public:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};

  static std::uint32_t triangleOf(std::uint32_t corner) { return corner / 4; }
  static std::uint32_t firstCorner(std::uint32_t triangle) { return 4 * triangle; }
  // The next corner of the same triangle, counter-clockwise and clockwise.
  static std::uint32_t next(std::uint32_t corner) {
    return (corner & ~3u) | ((0b001001u >> (2 * (corner & 3))) & 3u);
  }
  static std::uint32_t previous(std::uint32_t corner) {
    return (corner & ~3u) | ((0b010010u >> (2 * (corner & 3))) & 3u);
  }

  // Takes the triangles: three different vertices each, of so many.
  void set(std::span<const std::uint32_t> triangles, std::size_t vertices);

  std::uint32_t vertex(std::uint32_t corner) const {
    return triangles_[corner / 4].vertices[corner & 3];
  }
  // kNone at a border, and if the side has more than two triangles, or two in one direction.
  std::uint32_t opposite(std::uint32_t corner) const {
    return triangles_[corner / 4].opposites[corner & 3];
  }
  // The corner of the same vertex in the next triangle around it, counter-clockwise or clockwise;
  // kNone beyond a border.
  std::uint32_t left(std::uint32_t corner) const {
    const std::uint32_t facing = opposite(next(corner));
    return facing == kNone ? kNone : next(facing);
  }
  std::uint32_t right(std::uint32_t corner) const {
    const std::uint32_t facing = opposite(previous(corner));
    return facing == kNone ? kNone : previous(facing);
  }

  // All corners of a vertex, as long as no edge collapsed.
  std::span<const std::uint32_t> cornersOf(std::uint32_t vertex) const {
    return std::span(around_).subspan(first_[vertex], first_[vertex + 1] - first_[vertex]);
  }

  // The shape of the triangles around a vertex.
  enum class Ring : std::uint8_t {
    kClosed,  // one ring
    kOpen,    // part of a ring, as at a border
    kBroken   // anything else: no surface there
  };
  Ring ring(std::uint32_t vertex) const { return rings_[vertex]; }

  // What makes other triangles of these. The caller sees to it that the table stays consistent.
  void setVertex(std::uint32_t corner, std::uint32_t vertex) {
    triangles_[corner / 4].vertices[corner & 3] = vertex;
  }
  // The corners face each other from now on. One may be kNone.
  void join(std::uint32_t corner, std::uint32_t other) {
    if (corner != kNone) facing(corner) = other;
    if (other != kNone) facing(other) = corner;
  }
  void remove(std::uint32_t triangle) { triangles_[triangle].vertices[0] = kNone; }
  bool isAlive(std::uint32_t triangle) const { return triangles_[triangle].vertices[0] != kNone; }

  // Marks of corners mean what the caller likes; none has one at the beginning.
  enum class Mark : std::uint8_t { kFailed = 0, kWaits = 4 };
  bool isMarked(std::uint32_t corner, Mark mark) const {
    return (triangles_[corner / 4].marks >> bitOf(corner, mark) & 1) != 0;
  }
  void mark(std::uint32_t corner, Mark mark, bool is_marked) {
    std::uint32_t& marks = triangles_[corner / 4].marks;
    marks =
        (marks & ~(1u << bitOf(corner, mark))) | (std::uint32_t{is_marked} << bitOf(corner, mark));
  }
  std::uint32_t triangles() const { return static_cast<std::uint32_t>(triangles_.size()); }

 private:
  // Together, since all are needed at the same time.
  struct alignas(32) Triangle {
    std::array<std::uint32_t, 3> vertices, opposites;  // of corners
    std::uint32_t marks = 0;                           // bits by mark and corner
  };

  static std::uint32_t bitOf(std::uint32_t corner, Mark mark) {
    return (corner & 3) + static_cast<std::uint32_t>(mark);
  }
  std::uint32_t& facing(std::uint32_t corner) {
    return triangles_[corner / 4].opposites[corner & 3];
  }
  // A triangle around a vertex: its two other vertices, and the next triangle clockwise.
  struct Around {
    std::uint32_t to, back, clockwise = kNone;
  };
  // Joins the triangles around a vertex, and says what they make.
  Ring joinAround(std::uint32_t middle);
  Ring joinStrip();

  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> first_, around_;  // of each vertex: its corners at the beginning
  std::vector<Ring> rings_;                    // of vertices, at the beginning
  std::vector<Around> around_one_;
};

}  // namespace isobrick
