#include "isobrick/extract/simplify/deviation.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>

namespace isobrick {
namespace {

// A new triangle steeper than this against the mean normal is refused: the cosine, squared.
constexpr float kLeastCosineSquared = 0.01f;
// So much of the ring's extent, squared, is no area: slivers of the finest surface are rounded.
constexpr float kNoArea = 1e-7f;
// A new triangle less high than this over its longest side is refused: files round positions.
constexpr float kLeastHeight = 1.0f / 16384;
// An inner vertex within this of the new place, as a part of the ring's extent, lies there.
constexpr float kNoLength = 1e-5f;

// Calls it with `count` numbers from `first` on and as many more as make blocks of four, which the
// compiler computes at once.
template <typename Function>
void inFours(int first, int count, Function function) {
  for (int i = first; i < first + count; i += 4)
    for (int k = i; k < i + 4; ++k) function(k);
}

}  // namespace

bool DeviationBound::follow(const CollapseRegion& region, std::span<const Deviation> deviations,
                            float most) {
  if (!project(region) || !areRightWayRound(region)) return false;
  std::fill_n(least_.begin(), region.sides(), 0.0f);
  std::fill_n(most_.begin(), region.sides(), 0.0f);
  for (int i = 0; i < region.sides(); ++i) overlap_[i] = std::uint64_t{1} << i;
  for (int i = 0; i < region.inner; ++i) {
    if (!locate(region, kFirstInner + i, inner_[i])) return false;
    moveAtInner(region, kFirstInner + i, inner_[i]);
  }
  if (!region.is_open && !moveAtCenter(region)) return false;
  for (int i = 0; i < region.edges; ++i)
    if (!moveAlong(region, region.between[i])) return false;
  return findDeviations(region, deviations, most);
}

bool DeviationBound::project(const CollapseRegion& region) {
  const auto &px = region.places[0], &py = region.places[1], &pz = region.places[2];
  glm::vec3 area(0.0f);
  for (int i = 0; i < region.sides(); ++i) {
    const int j = i + 1 == region.ring ? 0 : i + 1;
    area.x += py[i] * pz[j] - pz[i] * py[j];
    area.y += pz[i] * px[j] - px[i] * pz[j];
    area.z += px[i] * py[j] - py[i] * px[j];
  }
  const float squared = glm::dot(area, area);
  if (!(squared > 0)) return false;
  normal_ = area / std::sqrt(squared);
  // An orthonormal basis without branches (Duff et al. 2017).
  const glm::vec3 z = normal_;
  const float sign = std::copysign(1.0f, z.z);
  const float a = -1.0f / (sign + z.z), b = z.x * z.y * a;
  const glm::vec3 x(1.0f + sign * z.x * z.x * a, sign * b, -sign * z.x);
  const glm::vec3 y(b, sign + z.y * z.y * a, -z.y);
  const auto put = [&](int i) {
    x_[i] = px[i] * x.x + py[i] * x.y + pz[i] * x.z;
    y_[i] = px[i] * y.x + py[i] * y.y + pz[i] * y.z;
    heights_[i] = px[i] * z.x + py[i] * z.y + pz[i] * z.z;
  };
  inFours(0, region.ring, put);
  inFours(kFirstInner, region.inner, put);
  // The first one again behind the last. An open ring needs none, and may leave no place for it.
  if (!region.is_open) {
    x_[region.ring] = x_[0];
    y_[region.ring] = y_[0];
    heights_[region.ring] = heights_[0];
  }
  inFours(0, region.ring, [&](int i) { squares_[i] = x_[i] * x_[i] + y_[i] * y_[i]; });
  if (!region.is_open) squares_[region.ring] = squares_[0];
  squared_extent_ = *std::max_element(squares_.begin(), squares_.begin() + region.ring);
  return true;
}

bool DeviationBound::areRightWayRound(const CollapseRegion& region) {
  const float least = kNoArea * squared_extent_;
  OfPoints<std::uint32_t> is_wrong;
  inFours(0, region.sides(), [&](int i) {
    const float area = x_[i] * y_[i + 1] - y_[i] * x_[i + 1];
    const float tilt_x = y_[i] * heights_[i + 1] - heights_[i] * y_[i + 1];
    const float tilt_y = heights_[i] * x_[i + 1] - x_[i] * heights_[i + 1];
    const bool is_flat = area * area * (1 - kLeastCosineSquared) >=
                         kLeastCosineSquared * (tilt_x * tilt_x + tilt_y * tilt_y);
    const float side_x = x_[i + 1] - x_[i], side_y = y_[i + 1] - y_[i];
    const float longest =
        std::max({squares_[i], squares_[i + 1], side_x * side_x + side_y * side_y});
    const bool is_high = area * area >= kLeastHeight * kLeastHeight * longest;
    turns_[i] = area;
    is_wrong[i] =
        std::uint32_t{!(area > least)} | std::uint32_t{!is_flat} | std::uint32_t{!is_high};
  });
  std::uint32_t wrong = 0;
  for (int i = 0; i < region.sides(); ++i) wrong |= is_wrong[i];
  if (wrong != 0) return false;
  for (int i = 0; i < region.triangles; ++i) {
    const auto [a, b, c] = region.old[i];
    const float area = (x_[b] - x_[a]) * (y_[c] - y_[a]) - (y_[b] - y_[a]) * (x_[c] - x_[a]);
    wrong |= std::uint32_t{!(area >= -least)};
  }
  return wrong == 0;
}

// Finds the sector with the vertex. If there is another one, the ring goes round more than once.
bool DeviationBound::locate(const CollapseRegion& region, int point, Inner& inner) const {
  const float x = x_[point], y = y_[point];
  inFours(0, region.ring, [&](int i) { inner.turns[i] = x_[i] * y - y_[i] * x; });
  inner.turns[region.ring] = inner.turns[0];
  inner.is_center = x * x + y * y <= kNoLength * kNoLength * squared_extent_;
  if (inner.is_center) return true;
  if (point == kFirstInner && region.border_point >= 0) {
    inner.turns[region.border_point] = 0;
    inner.sector = std::max(region.border_point - 1, 0);
    return true;
  }
  int found = 0;
  inner.sector = 0;
  for (int i = 0; i < region.sides(); ++i) {
    const int is_here = int{inner.turns[i] >= 0} & int{inner.turns[i + 1] < 0};
    found += is_here;
    inner.sector += is_here * i;
  }
  return found == 1;
}

void DeviationBound::moveAtInner(const CollapseRegion& region, int point, const Inner& inner) {
  if (inner.is_center) {
    for (int i = 0; i < region.sides(); ++i) move(i, -heights_[point]);
    return;
  }
  const int i = inner.sector;
  const float height =
      (inner.turns[i] * heights_[i + 1] - inner.turns[i + 1] * heights_[i]) / turns_[i];
  move(i, height - heights_[point]);
}

// The height of the old triangle below the new place: the one of whose sides it lies on the left.
bool DeviationBound::moveAtCenter(const CollapseRegion& region) {
  // Those that vanish lie in the middle, so they come first.
  for (int n = 0; n < region.triangles; ++n) {
    const auto [a, b, c] = region.old[(region.sides() + n) % region.triangles];
    const float at_a = turn(b, c), at_b = turn(c, a), at_c = turn(a, b);
    if (at_a < 0 || at_b < 0 || at_c < 0 || !(at_a + at_b + at_c > 0)) continue;
    const float height =
        (at_a * heights_[a] + at_b * heights_[b] + at_c * heights_[c]) / (at_a + at_b + at_c);
    for (int side = 0; side < region.sides(); ++side) move(side, -height);
    return true;
  }
  return false;
}

// Along an old edge, sector by sector.
bool DeviationBound::moveAlong(const CollapseRegion& region, const CollapseRegion::Edge& edge) {
  int from = edge.from, to = edge.to;
  if (to >= kFirstInner && innerOf(from).is_center) std::swap(from, to);
  if (innerOf(from).is_center) return true;
  // A ring point lies between two sectors. To the new place the edge stays in one.
  int last = to, other_last = region.before(to);
  if (to >= kFirstInner) last = other_last = innerOf(innerOf(to).is_center ? from : to).sector;
  const std::uint64_t beside = std::uint64_t{1} << edge.triangle | std::uint64_t{1} << edge.other;
  const std::array<float, kMostRing + 4>& turns = innerOf(from).turns;
  const bool is_left = turn(from, to) > 0;
  int sector = innerOf(from).sector;
  overlap_[sector] |= beside;
  for (int steps = 0; sector != last && sector != other_last; ++steps) {
    const int after = sector + 1 == region.ring ? 0 : sector + 1;
    const int ray = is_left ? after : sector;
    const int next = is_left ? after : region.before(sector);
    if (next >= region.sides() || steps == region.ring) return false;  // by rounding
    const float begin = turns[ray], end = turn(ray, to);
    if (begin != end) {
      const float part = begin / (begin - end);
      const float x = x_[from] + part * (x_[to] - x_[from]);
      const float y = y_[from] + part * (y_[to] - y_[from]);
      const float height = heights_[from] + part * (heights_[to] - heights_[from]);
      const float along = (x * x_[ray] + y * y_[ray]) / squares_[ray];
      const float way = along * heights_[ray] - height;
      move(sector, way);
      move(next, way);
    }
    sector = next;
    overlap_[sector] |= beside;
  }
  return true;
}

bool DeviationBound::findDeviations(const CollapseRegion& region,
                                    std::span<const Deviation> deviations, float most) {
  const Direction direction(normal_);
  const float shift = region.border_point < 0 ? 0.0f : glm::length(region.shift);
  const Direction shift_direction(shift > 0 ? region.shift / shift : glm::vec3(0.0f));
  for (int i = 0; i < region.sides(); ++i) {
    Deviation all;
    for (std::uint64_t old = overlap_[i]; old != 0; old &= old - 1)
      all.join(deviations[CornerTable::triangleOf(region.corners[std::countr_zero(old)])]);
    all.extend(direction, least_[i], most_[i]);
    all.extend(shift_direction, 0, shift);
    if (!(all.squaredLength() <= most * most)) return false;
    new_[i] = all;
  }
  return true;
}

}  // namespace isobrick
