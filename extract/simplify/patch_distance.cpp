#include "isobrick/extract/simplify/patch_distance.h"

#include <algorithm>
#include <glm/geometric.hpp>

namespace isobrick {
namespace {

float squaredToSegment(const glm::vec3& point, const glm::vec3& a, const glm::vec3& b) {
  const glm::vec3 along = b - a, to = point - a;
  const float length = glm::dot(along, along);
  const float t = length > 0 ? std::clamp(glm::dot(to, along) / length, 0.0f, 1.0f) : 0.0f;
  const glm::vec3 off = to - t * along;
  return glm::dot(off, off);
}

}  // namespace

float squaredDistance(const glm::vec3& point, const std::array<glm::vec3, 3>& corners) {
  const auto& [a, b, c] = corners;
  const glm::vec3 ab = b - a, ac = c - a, ap = point - a;
  const glm::vec3 normal = glm::cross(ab, ac);
  const float area = glm::dot(normal, normal);
  // Over the triangle: on the inner side of all three edges.
  const float u = glm::dot(glm::cross(ap, ac), normal), v = glm::dot(glm::cross(ab, ap), normal);
  if (area > 0 && u >= 0 && v >= 0 && u + v <= area) {
    const float height = glm::dot(ap, normal);
    return height * height / area;
  }
  return std::min({squaredToSegment(point, a, b), squaredToSegment(point, b, c),
                   squaredToSegment(point, c, a)});
}

std::uint32_t walkTo(const SurfacePatch& patch, const glm::vec3& point, std::uint32_t from) {
  constexpr int kMostSteps = 64;
  std::uint32_t at = from, before = SurfacePatch::kNone;
  for (int step = 0; step < kMostSteps; ++step) {
    const SurfacePatch::Facet& facet = patch.facet(at);
    float most = 0;
    std::uint32_t to = SurfacePatch::kNone;
    for (int side = 0; side < 3; ++side) {
      const float beyond = facet.sides[static_cast<std::size_t>(side)].valueAt(point);
      if (beyond <= most || patch.beside(at, side) == before) continue;
      most = beyond;
      to = patch.beside(at, side);
    }
    if (to == SurfacePatch::kNone) break;
    before = at;
    at = to;
  }
  return at;
}

bool DistanceProof::Piece::isWithin(const SurfacePatch::Facet& facet,
                                    float squared_distance) const {
  for (int i = 0; i < count; ++i)
    if (!(squaredDistance(corners[static_cast<std::size_t>(i)], facet.corners) <= squared_distance))
      return false;
  return true;
}

bool DistanceProof::cut(Piece& piece, const SurfacePatch::Plane& plane, Piece& beyond) {
  beyond.count = 0;
  std::array<float, kMostCorners> values;
  bool has_beyond = false;
  for (int i = 0; i < piece.count; ++i) {
    values[static_cast<std::size_t>(i)] = plane.valueAt(piece.corners[static_cast<std::size_t>(i)]);
    has_beyond |= values[static_cast<std::size_t>(i)] > 0;
  }
  if (!has_beyond) return true;
  if (piece.count + 2 > kMostCorners) return false;
  Piece within;
  within.triangle = piece.triangle;
  within.from = piece.from;
  for (int i = 0; i < piece.count; ++i) {
    const auto here = static_cast<std::size_t>(i);
    const auto there = static_cast<std::size_t>(i + 1 == piece.count ? 0 : i + 1);
    const float a = values[here], b = values[there];
    const glm::vec3& at = piece.corners[here];
    if (a <= 0) within.corners[static_cast<std::size_t>(within.count++)] = at;
    if (a >= 0) beyond.corners[static_cast<std::size_t>(beyond.count++)] = at;
    if ((a < 0 && b > 0) || (a > 0 && b < 0)) {
      // Both halves get the same corner.
      const glm::vec3 between = at + a / (a - b) * (piece.corners[there] - at);
      within.corners[static_cast<std::size_t>(within.count++)] = between;
      beyond.corners[static_cast<std::size_t>(beyond.count++)] = between;
    }
  }
  piece = within;
  return true;
}

bool DistanceProof::isWithin(const SurfacePatch& patch, const std::array<glm::vec3, 3>& corners,
                             std::uint32_t start, float distance) {
  const float squared = distance * distance;
  Piece whole;
  std::copy(corners.begin(), corners.end(), whole.corners.begin());
  whole.count = 3;
  whole.triangle = start;
  pieces_.assign(1, whole);
  for (int tried = 0; !pieces_.empty(); ++tried) {
    if (tried == kMostPieces) return false;
    Piece piece = pieces_.back();
    pieces_.pop_back();
    const SurfacePatch::Facet& facet = patch.facet(piece.triangle);
    if (piece.isWithin(facet, squared)) continue;
    for (int side = 0; side < 3 && piece.count > 0; ++side) {
      const std::uint32_t other = patch.beside(piece.triangle, side);
      if (other == SurfacePatch::kNone || other == piece.from) continue;
      Piece beyond;
      if (!cut(piece, facet.sides[static_cast<std::size_t>(side)], beyond)) return false;
      if (beyond.count == 0) continue;
      beyond.triangle = other;
      beyond.from = piece.triangle;
      pieces_.push_back(beyond);
    }
    if (!piece.isWithin(facet, squared)) return false;
  }
  return true;
}

}  // namespace isobrick
