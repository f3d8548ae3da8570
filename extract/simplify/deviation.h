// The distance that a surface moves when an edge of it collapses.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>

namespace isobrick {

// All ways that points of a triangle may have come from the finest surface, as a box of vectors.
struct Deviation {
  glm::vec3 lower{0.0f}, upper{0.0f};

  void join(const Deviation& other) {
    lower = glm::min(lower, other.lower);
    upper = glm::max(upper, other.upper);
  }
  // Goes on from each of them by `least` to `most` times the direction; least <= 0 <= most.
  void extend(const glm::vec3& direction, float least, float most) {
    lower += glm::min(least * direction, most * direction);
    upper += glm::max(least * direction, most * direction);
  }
  // At least the square of the longest.
  float squaredLength() const {
    const glm::vec3 most = glm::max(-lower, upper);
    return most.x * most.x + most.y * most.y + most.z * most.z;
  }
};

// The triangles around an edge that collapses, and those that take their place.
//
// The ring is the border of the old triangles, counter-clockwise: the third corner of the triangle
// on the left of the edge first, then what is around the vertex that goes, to the third corner of
// the triangle on the right, then what is around the vertex that stays. If the latter is fixed, the
// ring is open: it ends with that third corner, and what is around the fixed vertex stays.
//
// Old triangle i lies between ring vertices i and i + 1, for i below sides(); then come the two at
// the edge, the left one first. New triangle i has ring vertices i and i + 1 as well.
struct CollapseRegion {
  static constexpr int kMostRing = 28;

  int count = 0;         // of the ring
  int last_of_gone = 0;  // index in the ring of the third corner on the right
  bool is_open = false;
  std::array<glm::vec3, kMostRing> ring;  // relative to the new place of the vertex that stays
  glm::vec3 gone{0.0f}, kept{0.0f};       // old places of both ends, likewise; kept is 0 if open
  std::array<std::uint32_t, kMostRing + 2> old_triangles;  // numbers of the caller

  int sides() const { return is_open ? count - 1 : count; }
  int after(int i) const { return i + 1 == count ? 0 : i + 1; }
  int before(int i) const { return i == 0 ? count - 1 : i - 1; }
};

// Follows old triangles to new ones.
//
// Along one direction, the mean normal, both lie over the same polygon of a plane, each once, if
// all of them are the right way round; that is refused otherwise. Then this direction carries each
// point of the old triangles to one of the new ones and back. The way is linear between the corners
// of the pieces that both have in common: it is greatest at such corners, which are the vertices
// and where old edges cross new ones. Sums of such ways join the finest surface and what is left of
// it, point for point, so the distance between them is bounded in both directions (Cohen, Manocha
// and Olano 1997: successive mappings).
class DeviationBound {
 public:
  // The deviations of the new triangles, from those of all old ones; false if there is no such
  // direction, or if one of them might be longer than `most`.
  bool follow(const CollapseRegion& region, std::span<const Deviation> deviations, float most);
  // The deviation of new triangle i, after follow() was true.
  const Deviation& deviation(int i) const { return new_[static_cast<std::size_t>(i)]; }

 private:
  static constexpr int kMostRing = CollapseRegion::kMostRing;
  // An end of the edge, seen from the new place.
  struct End {
    glm::vec2 at{0.0f};
    float height = 0;
    int sector = 0;  // of the new triangle that it lies over
    bool is_center = false;
    std::array<float, kMostRing> turns;  // from ring vertex i to it: above 0 counter-clockwise
  };
  // The other end of an old edge, in either of two sectors: those beside a ring vertex.
  struct Target {
    glm::vec2 at;
    float height;
    int sector, other_sector;
  };

  bool project(const CollapseRegion& region);
  bool areRightWayRound(const CollapseRegion& region);
  bool place(const CollapseRegion& region, End& end) const;
  // The ways at the vertices that only one of both has, and where edges cross.
  void moveAtEnd(const CollapseRegion& region, const End& end);
  void moveAtCenter(const CollapseRegion& region);
  bool moveAlongEdges(const CollapseRegion& region);
  bool moveAlong(const CollapseRegion& region, const End& from, const Target& to,
                 std::uint32_t beside);
  void move(int sector, float way) {
    least_[sector] = std::min(least_[sector], way);
    most_[sector] = std::max(most_[sector], way);
  }

  glm::vec3 normal_{0.0f};
  float squared_extent_ = 0;  // of the ring
  std::array<glm::vec2, kMostRing> at_;
  std::array<float, kMostRing> heights_, turns_;  // turns_[i]: from ring vertex i to the next
  End gone_, kept_;
  std::array<float, kMostRing> least_, most_;     // ways of each new triangle
  std::array<std::uint32_t, kMostRing> overlap_;  // bit i: of each new one, old triangle i
  std::array<Deviation, kMostRing> new_;
};

}  // namespace isobrick
