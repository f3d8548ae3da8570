// Distances and angles that the user measures between points of the surface, straight or over it.
#pragma once

#include <functional>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/geodesic/surface_path.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// Two points: the length of the straight line between them. Three: the angle at the second.
struct ViewMeasurement {
  std::vector<glm::dvec3> points;  // world
  // With two points: the distance is that over the surface of this isovalue. Its path follows from
  // this, and is not a part of the view.
  std::optional<double> surface_isovalue = {};

  bool isAngle() const { return points.size() == 3; }
  // The straight distance, world units; degrees, 0 .. 180, of an angle, which is 0 if a leg of it
  // has no length.
  double value() const;
  bool operator==(const ViewMeasurement&) const = default;
};

inline constexpr std::size_t kMostMeasurements = 64;

// The path of a measurement over the surface.
struct FoundPath {
  SurfacePath path;
  std::string error;  // one line, if there is none; else empty
};
// Null: it is not found yet.
using PathOf = std::function<const FoundPath*(const ViewMeasurement&)>;

// "12.35 mm", "12.35" if the world's unit is not known, "90.0°"; over the surface with these words,
// and the level if it is not 0.
std::string measurementText(const ViewMeasurement& measurement, LengthUnit unit,
                            const PathOf& path_of);

// A line for each: number, kind, value, unit, and x, y and z of the points, separated by commas.
// One without a path has no value.
std::string measurementsCsv(const std::vector<ViewMeasurement>& measurements, LengthUnit unit,
                            const PathOf& path_of);

}  // namespace isobrick
