#include "isobrick/extract/simplify/deviation.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>

namespace isobrick {
namespace {

// A new triangle steeper than this against the mean normal is refused: the cosine, squared.
constexpr float kLeastCosineSquared = 0.01f;
// So much of the ring's extent, squared, is no area: slivers of the finest surface are rounded.
constexpr float kNoArea = 1e-7f;
// An end within this of the new place, as a part of the ring's extent, lies there.
constexpr float kNoLength = 1e-5f;

float turn(const glm::vec2& a, const glm::vec2& b) { return a.x * b.y - a.y * b.x; }

}  // namespace

bool DeviationBound::follow(const CollapseRegion& region, std::span<const Deviation> deviations,
                            float most) {
  if (!project(region) || !areRightWayRound(region)) return false;
  const int sides = region.sides();
  std::fill_n(least_.begin(), sides, 0.0f);
  std::fill_n(most_.begin(), sides, 0.0f);
  for (int i = 0; i < sides; ++i) overlap_[i] = 1u << i;
  if (!place(region, gone_)) return false;
  moveAtEnd(region, gone_);
  kept_.is_center = region.is_open;
  if (!region.is_open) {
    if (!place(region, kept_)) return false;
    moveAtEnd(region, kept_);
    moveAtCenter(region);
  }
  if (!moveAlongEdges(region)) return false;
  for (int i = 0; i < sides; ++i) {
    Deviation& all = new_[i];
    std::uint32_t old = overlap_[i];
    all = deviations[region.old_triangles[std::countr_zero(old)]];
    for (old &= old - 1; old != 0; old &= old - 1)
      all.join(deviations[region.old_triangles[std::countr_zero(old)]]);
    all.extend(normal_, least_[i], most_[i]);
    if (!(all.squaredLength() <= most * most)) return false;
  }
  return true;
}

bool DeviationBound::project(const CollapseRegion& region) {
  glm::vec3 area(0.0f);
  for (int i = 0; i < region.sides(); ++i)
    area += glm::cross(region.ring[i], region.ring[region.after(i)]);
  const float squared = glm::dot(area, area);
  if (!(squared > 0)) return false;
  normal_ = area / std::sqrt(squared);
  // An orthonormal basis without branches (Duff et al. 2017).
  const float sign = std::copysign(1.0f, normal_.z);
  const float a = -1.0f / (sign + normal_.z), b = normal_.x * normal_.y * a;
  const glm::vec3 x(1.0f + sign * normal_.x * normal_.x * a, sign * b, -sign * normal_.x);
  const glm::vec3 y(b, sign + normal_.y * normal_.y * a, -normal_.y);
  const auto put = [&](const glm::vec3& p, glm::vec2& at, float& height) {
    at = {glm::dot(p, x), glm::dot(p, y)};
    height = glm::dot(p, normal_);
  };
  squared_extent_ = 0;
  for (int i = 0; i < region.count; ++i) {
    put(region.ring[i], at_[i], heights_[i]);
    squared_extent_ = std::max(squared_extent_, glm::dot(at_[i], at_[i]));
  }
  put(region.gone, gone_.at, gone_.height);
  put(region.kept, kept_.at, kept_.height);
  return true;
}

bool DeviationBound::areRightWayRound(const CollapseRegion& region) {
  const float least = -kNoArea * squared_extent_;
  for (int i = 0; i < region.sides(); ++i) {
    const int j = region.after(i);
    turns_[i] = turn(at_[i], at_[j]);
    if (!(turns_[i] > -least)) return false;
    const float tilt_x = at_[i].y * heights_[j] - heights_[i] * at_[j].y;
    const float tilt_y = heights_[i] * at_[j].x - at_[i].x * heights_[j];
    if (turns_[i] * turns_[i] * (1 - kLeastCosineSquared) <
        kLeastCosineSquared * (tilt_x * tilt_x + tilt_y * tilt_y))
      return false;
    const glm::vec2& old = i < region.last_of_gone ? gone_.at : kept_.at;
    if (turn(at_[i] - old, at_[j] - old) < least) return false;
  }
  const glm::vec2 along = kept_.at - gone_.at;
  return turn(along, at_[0] - gone_.at) >= least &&
         turn(at_[region.last_of_gone] - gone_.at, along) >= least;
}

// Finds the sector with the end. If there is another one, the ring goes round more than once.
bool DeviationBound::place(const CollapseRegion& region, End& end) const {
  for (int i = 0; i < region.count; ++i) end.turns[i] = turn(at_[i], end.at);
  end.is_center = glm::dot(end.at, end.at) <= kNoLength * kNoLength * squared_extent_;
  if (end.is_center) return true;
  int found = 0;
  for (int i = 0; i < region.sides(); ++i)
    if (end.turns[i] >= 0 && end.turns[region.after(i)] < 0) {
      end.sector = i;
      ++found;
    }
  return found == 1;
}

void DeviationBound::moveAtEnd(const CollapseRegion& region, const End& end) {
  if (end.is_center) {
    for (int i = 0; i < region.sides(); ++i) move(i, -end.height);
    return;
  }
  const int i = end.sector, j = region.after(i);
  move(i, (end.turns[i] * heights_[j] - end.turns[j] * heights_[i]) / turns_[i] - end.height);
}

// The height of the old triangle below the new place: the one of whose sides it lies on the left.
void DeviationBound::moveAtCenter(const CollapseRegion& region) {
  const auto heightOf = [](const glm::vec2& a, float a_height, const glm::vec2& b, float b_height,
                           const glm::vec2& c, float c_height) {
    const float at_a = turn(b, c), at_b = turn(c, a), at_c = turn(a, b);
    return (at_a * a_height + at_b * b_height + at_c * c_height) / (at_a + at_b + at_c);
  };
  float height = 0;
  bool is_found = false;
  for (int i = 0; i < region.sides() && !is_found; ++i) {
    const End& end = i < region.last_of_gone ? gone_ : kept_;
    const int j = region.after(i);
    if (end.turns[i] > 0 || end.turns[j] <= 0) continue;
    height = heightOf(end.at, end.height, at_[i], heights_[i], at_[j], heights_[j]);
    is_found = true;
  }
  if (!is_found) {
    const int third = turn(gone_.at, kept_.at) >= 0 ? 0 : region.last_of_gone;
    height = heightOf(gone_.at, gone_.height, kept_.at, kept_.height, at_[third], heights_[third]);
  }
  for (int i = 0; i < region.sides(); ++i) move(i, -height);
}

bool DeviationBound::moveAlongEdges(const CollapseRegion& region) {
  const std::uint32_t left = 1u << region.sides(), right = left << 1;  // the two at the edge
  const auto bit = [](int i) { return 1u << i; };
  const auto target = [&](int i) { return Target{at_[i], heights_[i], i, region.before(i)}; };
  const int last = region.last_of_gone;
  bool is_good = true;
  if (!gone_.is_center)
    for (int i = 0; i <= last; ++i)
      is_good = is_good && moveAlong(region, gone_, target(i),
                                     (i == 0 ? left : bit(i - 1)) | (i == last ? right : bit(i)));
  if (!kept_.is_center) {
    for (int i = last; i < region.count; ++i)
      is_good =
          is_good && moveAlong(region, kept_, target(i), (i == last ? right : bit(i - 1)) | bit(i));
    is_good = is_good && moveAlong(region, kept_, target(0), bit(region.count - 1) | left);
  }
  if (!gone_.is_center && !kept_.is_center)
    return is_good && moveAlong(region, gone_, {kept_.at, kept_.height, kept_.sector, kept_.sector},
                                left | right);
  // From the new place on it stays in one sector.
  overlap_[(gone_.is_center ? kept_ : gone_).sector] |= left | right;
  return is_good;
}

// Along an old edge, sector by sector. `beside`: the old triangles at it.
bool DeviationBound::moveAlong(const CollapseRegion& region, const End& from, const Target& to,
                               std::uint32_t beside) {
  const bool is_left = turn(from.at, to.at) > 0;
  int sector = from.sector;
  overlap_[sector] |= beside;
  for (int steps = 0; sector != to.sector && sector != to.other_sector; ++steps) {
    const int ray = is_left ? region.after(sector) : sector;
    const int next = is_left ? ray : region.before(sector);
    if (next >= region.sides() || steps == region.count) return false;  // by rounding
    const float before = from.turns[ray], after = turn(at_[ray], to.at);
    if (before != after) {
      const float part = before / (before - after);
      const glm::vec2 at = from.at + part * (to.at - from.at);
      const float height = from.height + part * (to.height - from.height);
      const float along = glm::dot(at, at_[ray]) / glm::dot(at_[ray], at_[ray]);
      const float way = along * heights_[ray] - height;
      move(sector, way);
      move(next, way);
    }
    sector = next;
    overlap_[sector] |= beside;
  }
  return true;
}

}  // namespace isobrick
