// Distances and angles that the user measures between points of the surface, the choice among its
// pieces, and the measures of these.
#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/sinks/component_choice.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// Four digits, and all of those before the point: 0.1235, 112.2, 65535.
inline std::string shortNumber(double value) {
  const double size = std::abs(value);
  const bool is_long = size >= 1e4 && size < 1e15;
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), is_long ? "%.0f" : "%.4g", value);
  return text.data();
}

// Two points: the length of the straight line between them. Three: the angle at the second.
struct ViewMeasurement {
  std::vector<glm::dvec3> points;  // world

  bool isAngle() const { return points.size() == 3; }
  // The distance, world units; degrees, 0 .. 180, of an angle, which is 0 if a leg of it
  // has no length.
  double value() const;
  bool operator==(const ViewMeasurement&) const = default;
};

inline constexpr std::size_t kMostMeasurements = 64;

// "12.35 mm", "12.35" if the world's unit is not known, "90.0°".
std::string measurementText(const ViewMeasurement& measurement, LengthUnit unit);

// A line for each: number, kind, value, unit, and x, y and z of the points, separated by commas.
std::string measurementsCsv(const std::vector<ViewMeasurement>& measurements, LengthUnit unit);

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
