#include "isobrick/extract/simplify/collapse_region.h"

#include <algorithm>
#include <span>

namespace isobrick {
namespace {

std::uint8_t byteOf(int number) { return static_cast<std::uint8_t>(number); }

}  // namespace

bool CollapseRegion::addRingPoint(std::uint32_t vertex) {
  if (ring == kMostRing) return false;
  vertices[ring++] = vertex;
  return true;
}

// The triangles around an inner point from one of its corners to another, counter-clockwise.
bool CollapseRegion::addSides(const CornerTable& table, int point, std::uint32_t from,
                              std::uint32_t end) {
  for (std::uint32_t at = from; at != end; at = table.left(at)) {
    old[ring - 1] = {byteOf(point), byteOf(ring - 1), byteOf(ring)};
    corners[ring - 1] = at;
    if (!addRingPoint(table.vertex(CornerTable::previous(at)))) return false;
  }
  return true;
}

// The last point was the first one again.
void CollapseRegion::closeRing() {
  --ring;
  old[ring - 1].c = 0;
}

void CollapseRegion::addTriangle(int a, int b, int c, std::uint32_t corner) {
  old[triangles] = {byteOf(a), byteOf(b), byteOf(c)};
  corners[triangles++] = corner;
}

void CollapseRegion::addEdge(int from, int to, int triangle, int other) {
  between[edges++] = {byteOf(from), byteOf(to), byteOf(triangle), byteOf(other)};
}

bool CollapseRegion::findEdge(const CornerTable& table, std::uint32_t corner, bool end_stays) {
  constexpr int kGone = kFirstInner, kKept = kGone + 1;
  const std::uint32_t at_kept = CornerTable::next(corner);
  const std::uint32_t beyond = table.opposite(CornerTable::previous(corner));
  const std::uint32_t gone_beyond = CornerTable::previous(beyond);
  is_open = end_stays;
  border_point = -1;
  inner = 2;
  vertices[kGone] = table.vertex(corner);
  vertices[kKept] = table.vertex(at_kept);
  ring = 0;
  addRingPoint(table.vertex(CornerTable::previous(corner)));
  if (!addSides(table, kGone, table.left(corner), gone_beyond)) return false;
  const int last_of_gone = ring - 1;
  if (last_of_gone == 0) return false;
  if (!is_open) {
    if (!addSides(table, kKept, table.left(CornerTable::next(beyond)), at_kept)) return false;
    if (ring == last_of_gone + 1) return false;
    closeRing();
    if (ring < 3) return false;
  }
  triangles = sides();
  const int left = triangles, right = left + 1;
  addTriangle(kGone, kKept, 0, corner);
  addTriangle(kGone, last_of_gone, kKept, gone_beyond);
  edges = 0;
  for (int i = 0; i <= last_of_gone; ++i)
    addEdge(kGone, i, i == 0 ? left : i - 1, i == last_of_gone ? right : i);
  if (!is_open) {
    for (int i = last_of_gone; i < ring; ++i)
      addEdge(kKept, i, i == last_of_gone ? right : i - 1, i);
    addEdge(kKept, 0, ring - 1, left);
  }
  addEdge(kGone, kKept, left, right);
  return true;
}

bool CollapseRegion::findBorder(const CornerTable& table, std::uint32_t corner,
                                bool becomes_first) {
  constexpr int kGone = kFirstInner, kKept = kGone + 1;
  std::uint32_t last = corner;
  while (table.left(last) != CornerTable::kNone) last = table.left(last);
  is_open = true;
  inner = 2;
  vertices[kGone] = table.vertex(corner);
  vertices[kKept] =
      table.vertex(becomes_first ? CornerTable::next(corner) : CornerTable::previous(last));
  ring = 0;
  addRingPoint(
      table.vertex(becomes_first ? CornerTable::previous(corner) : CornerTable::next(corner)));
  const bool fits = becomes_first ? addSides(table, kGone, table.left(corner), CornerTable::kNone)
                                  : addSides(table, kGone, corner, last);
  if (!fits || ring < 2) return false;
  border_point = becomes_first ? ring - 1 : 0;
  triangles = sides();
  const int vanishing = triangles;
  if (becomes_first)
    addTriangle(kGone, kKept, 0, corner);
  else
    addTriangle(kGone, ring - 1, kKept, last);
  edges = 0;
  for (int i = 0; i < ring; ++i)
    if (i != border_point)
      addEdge(kGone, i, i == 0 ? vanishing : i - 1, i == ring - 1 ? vanishing : i);
  return true;
}

bool CollapseRegion::findStar(const CornerTable& table, std::uint32_t corner) {
  is_open = false;
  border_point = -1;
  inner = 1;
  vertices[kFirstInner] = table.vertex(corner);
  std::uint32_t at = corner;
  do {
    if (inner == kMostInner) return false;
    spokes_[inner - 1] = at;
    vertices[kFirstInner + inner++] = table.vertex(CornerTable::next(at));
    at = table.left(at);
  } while (at != corner);
  return inner > 3;
}

// Arm i is point kFirstInner + 1 + i. The ring has a point across the side between two arms, and
// between two of these it goes around one arm.
bool CollapseRegion::findAroundStar(const CornerTable& table) {
  const int arms = inner - 1;
  const auto after = [&](int arm) { return arm + 1 == arms ? 0 : arm + 1; };
  std::array<int, kMostInner> across;  // ring points across the side between arms i and i + 1
  ring = 0;
  addRingPoint(table.vertex(table.opposite(spokes_[0])));
  for (int arm = 0; arm < arms; ++arm) {
    across[arm] = ring - 1;
    const std::uint32_t from = CornerTable::next(table.opposite(spokes_[arm])),
                        end = CornerTable::previous(table.opposite(spokes_[after(arm)]));
    if (!addSides(table, kFirstInner + 1 + after(arm), table.left(from), end)) return false;
  }
  across[arms] = ring - 1;
  if (ring < 4) return false;
  closeRing();
  const auto inside = std::span(vertices).subspan(kFirstInner, static_cast<std::size_t>(inner));
  for (int i = 0; i < ring; ++i)
    if (std::ranges::find(inside, vertices[i]) != inside.end()) return false;

  triangles = ring;
  edges = 0;
  const int center = kFirstInner, first_beyond = ring + arms;
  const auto ringPoint = [&](int i) { return i == ring ? 0 : i; };
  for (int arm = 0; arm < arms; ++arm) {
    const int point = center + 1 + arm, next_point = center + 1 + after(arm);
    addTriangle(center, point, next_point, spokes_[arm]);
    addEdge(center, next_point, ring + arm, ring + after(arm));
    addEdge(point, next_point, ring + arm, first_beyond + arm);
    for (int i = across[arm]; i <= across[arm + 1]; ++i)
      addEdge(next_point, ringPoint(i), i == across[arm] ? first_beyond + arm : i - 1,
              i == across[arm + 1] ? first_beyond + after(arm) : i);
  }
  for (int arm = 0; arm < arms; ++arm)
    addTriangle(center + 1 + after(arm), center + 1 + arm, ringPoint(across[arm]),
                CornerTable::next(table.opposite(spokes_[arm])));
  return true;
}

void CollapseRegion::replace(CornerTable& table, std::uint32_t vertex) const {
  std::uint32_t last = corners[sides() - 1];
  if (is_open) {
    // At the border there is one of both.
    const std::uint32_t left = corners[sides()], right = corners[triangles - 1];
    if (border_point != 0) table.join(CornerTable::previous(corners[0]), table.opposite(left));
    if (border_point <= 0) table.join(CornerTable::next(last), table.opposite(right));
  }
  for (int i = 0; i < sides(); ++i) {
    const std::uint32_t at = corners[i];
    table.setVertex(at, vertex);
    if (i > 0 || !is_open) table.join(CornerTable::next(last), CornerTable::previous(at));
    last = at;
  }
  for (int i = sides(); i < triangles; ++i) table.remove(CornerTable::triangleOf(corners[i]));
}

}  // namespace isobrick
