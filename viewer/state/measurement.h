// Distances and angles that the user measures between points of the surface.
#pragma once

#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick {

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

}  // namespace isobrick
