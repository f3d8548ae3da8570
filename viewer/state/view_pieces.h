// The user's choice among the pieces of a surface, and the measures of pieces.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/sinks/component_choice.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

inline constexpr std::size_t kMostSeeds = 64;          // of each kind, of a surface
inline constexpr std::size_t kMostPieceMeasures = 64;  // of a view

// A piece that the user measured; it stays as it was then. World units.
struct ViewPieceMeasure {
  double isovalue = 0.0;
  int level = 0;  // of the pyramid that it was measured at
  double area = 0.0;
  std::optional<double> volume;  // enclosed; none: it is open
  glm::dvec3 lower{0.0}, upper{0.0};
  glm::dvec3 center{0.0};  // of the surface's area
  glm::dvec3 point{0.0};   // on it

  bool operator==(const ViewPieceMeasure&) const = default;
};

// Only this piece.
void keepOnly(const ComponentSeed& piece, PieceChoice& choice);
// Beside others that are hidden, or no longer among those that are kept. False: kMostSeeds of them
// are hidden already.
bool hide(const ComponentSeed& piece, PieceChoice& choice);
// With every number in its range.
PieceChoice bounded(const PieceChoice& choice);

ViewPieceMeasure measureOf(const SurfaceComponent& piece, double isovalue, int level);
// "123.4 mm2, 56.7 mm3"; without a unit if that is not known, and without a volume if it is open.
std::string pieceText(const ViewPieceMeasure& piece, LengthUnit unit);
// Lines that follow those of measurementsCsv(), numbered from `first` on: of each piece its area,
// its volume and its extent along x, y and z, each with centre, lower and upper corner as points.
std::string pieceMeasuresCsv(const std::vector<ViewPieceMeasure>& pieces, std::size_t first,
                             LengthUnit unit);

}  // namespace isobrick
