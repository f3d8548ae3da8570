// The distance that a surface moves when vertices of it become one.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>

#include "isobrick/extract/simplify/collapse_region.h"

namespace isobrick {

// A direction, and the one back: how far down and up each axis, in the order of Deviation::most.
struct Direction {
  explicit Direction(const glm::vec3& direction) {
    for (int axis = 0; axis < 3; ++axis) {
      along[axis] = back[4 + axis] = std::max(-direction[axis], 0.0f);
      along[4 + axis] = back[axis] = std::max(direction[axis], 0.0f);
    }
  }
  alignas(16) std::array<float, 8> along{}, back{};
};

// All ways that points of a triangle may have come from the finest surface: a box of vectors.
struct Deviation {
  // How far down and up each axis: x, y and z down, nothing, x, y and z up, nothing. None is below
  // 0.
  alignas(16) std::array<float, 8> most{};

  float lower(int axis) const { return -most[axis]; }
  float upper(int axis) const { return most[4 + axis]; }
  void join(const Deviation& other) {
    for (int i = 0; i < 8; ++i) most[i] = std::max(most[i], other.most[i]);
  }
  // Goes on from each of them by `least` to `most_way` times the direction; least <= 0 <= most_way.
  void extend(const Direction& direction, float least, float most_way) {
    for (int i = 0; i < 8; ++i)
      most[i] += most_way * direction.along[i] - least * direction.back[i];
  }
  // At least the square of the longest.
  float squaredLength() const {
    float sum = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const float longest = std::max(most[axis], most[4 + axis]);
      sum += longest * longest;
    }
    return sum;
  }
};

// Follows the old triangles of a region to the new ones.
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
  // Finds the deviations of the new triangles from those of the old ones, to which the corners of
  // the region belong. Returns false if there is no such direction, or if a deviation might be
  // longer than `most`.
  bool follow(const CollapseRegion& region, std::span<const Deviation> deviations, float most);
  // The deviation of new triangle i, after follow() was true.
  const Deviation& deviation(int i) const { return new_[i]; }

 private:
  static constexpr int kMostRing = CollapseRegion::kMostRing;
  static constexpr int kMostInner = CollapseRegion::kMostInner;
  static constexpr int kFirstInner = CollapseRegion::kFirstInner;
  template <typename Value>
  using OfPoints = std::array<Value, CollapseRegion::kMostPoints>;
  // An inner vertex, seen from the new place.
  struct Inner {
    int sector = 0;  // of the new triangle that it lies over
    bool is_center = false;
    std::array<float, kMostRing + 4> turns;  // from ring point i to it: above 0 counter-clockwise
  };

  bool project(const CollapseRegion& region);
  bool areRightWayRound(const CollapseRegion& region);
  bool locate(const CollapseRegion& region, int point, Inner& inner) const;
  // The ways at the vertices that only one of both has, and where edges cross.
  void moveAtInner(const CollapseRegion& region, int point, const Inner& inner);
  bool moveAtCenter(const CollapseRegion& region);
  bool moveAlong(const CollapseRegion& region, const CollapseRegion::Edge& edge);
  bool findDeviations(const CollapseRegion& region, std::span<const Deviation> deviations,
                      float most);
  // The area, doubled, of the triangle with the new place; above 0 counter-clockwise.
  float turn(int a, int b) const { return x_[a] * y_[b] - y_[a] * x_[b]; }
  const Inner& innerOf(int point) const { return inner_[point - kFirstInner]; }
  void move(int sector, float way) {
    least_[sector] = std::min(least_[sector], way);
    most_[sector] = std::max(most_[sector], way);
  }

  glm::vec3 normal_{0.0f};
  float squared_extent_ = 0;               // of the ring
  OfPoints<float> x_{}, y_{}, heights_{};  // in the plane, and above it
  OfPoints<float> squares_, turns_;        // of ring points: to the place, and to the next one
  std::array<Inner, kMostInner> inner_;
  std::array<float, kMostRing> least_, most_;     // ways of each new triangle
  std::array<std::uint64_t, kMostRing> overlap_;  // bit i: of each new one, old triangle i
  std::array<Deviation, kMostRing> new_;
};

}  // namespace isobrick
