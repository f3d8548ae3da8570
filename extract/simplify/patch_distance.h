// Whether a triangle lies within a distance of a surface, with proof.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/extract/simplify/surface_patch.h"

namespace isobrick {

// Squared distance of a point to a triangle.
float squaredDistance(const glm::vec3& point, const std::array<glm::vec3, 3>& corners);

// From a triangle of the patch on, over the sides that the point lies beyond, to one that it lies
// over. May end beside it, on a surface that is far from the point.
std::uint32_t walkTo(const SurfacePatch& patch, const glm::vec3& point, std::uint32_t from);

// Proves distances, with memory that goes round.
//
// The distance to a triangle is a convex function, so it is greatest at a corner of a convex piece:
// a piece with all its corners within the distance of one triangle is within it as a whole. A
// triangle that is not is cut at the planes between that triangle and its neighbours, and the
// pieces beyond are tried with these, and so on. True is a proof but for the rounding of floats;
// false says that no proof was found.
class DistanceProof {
 public:
  // `start`: a triangle of the patch that is near a point of `corners`.
  bool isWithin(const SurfacePatch& patch, const std::array<glm::vec3, 3>& corners,
                std::uint32_t start, float distance);

 private:
  static constexpr int kMostCorners = 14, kMostPieces = 20'000;
  struct Piece {
    std::array<glm::vec3, kMostCorners> corners;
    int count = 0;
    std::uint32_t triangle = 0;                // of the patch, that it is tried with
    std::uint32_t from = SurfacePatch::kNone;  // that it was cut off from
    bool isWithin(const SurfacePatch::Facet& facet, float squared_distance) const;
  };
  // Cuts off what lies beyond the plane. False if there is no room for its corners.
  static bool cut(Piece& piece, const SurfacePatch::Plane& plane, Piece& beyond);

  std::vector<Piece> pieces_;
};

}  // namespace isobrick
