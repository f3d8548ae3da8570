#include "isobrick/viewer/state/measurement.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>

#include "isobrick/viewer/state/short_number.h"

namespace isobrick {

double ViewMeasurement::value() const {
  if (!isAngle()) return glm::distance(points[0], points[1]);
  const glm::dvec3 a = points[0] - points[1], b = points[2] - points[1];
  // By both products: the arc cosine alone loses half of the digits of small angles.
  return glm::degrees(std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)));
}

std::string measurementText(const ViewMeasurement& measurement, LengthUnit unit) {
  if (!measurement.isAngle())
    return shortNumber(measurement.value()) + (unit == LengthUnit::kMillimetre ? " mm" : "");
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.1f\u00b0", measurement.value());
  return text.data();
}

std::string measurementsCsv(const std::vector<ViewMeasurement>& measurements, LengthUnit unit) {
  std::string csv = "number,kind,value,unit,x1,y1,z1,x2,y2,z2,x3,y3,z3\n";
  const std::string length = unit == LengthUnit::kMillimetre ? "mm" : "";
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    const ViewMeasurement& measurement = measurements[i];
    csv += std::to_string(i + 1);
    csv += measurement.isAngle() ? ",angle" : ",distance";
    const auto add = [&](double number) {
      std::array<char, 32> text{};
      std::snprintf(text.data(), text.size(), ",%.9g", number);
      csv += text.data();
    };
    add(measurement.value());
    csv += "," + (measurement.isAngle() ? std::string("degrees") : length);
    for (const glm::dvec3& point : measurement.points)
      for (int axis = 0; axis < 3; ++axis) add(point[axis]);
    csv += measurement.isAngle() ? "\n" : ",,,\n";
  }
  return csv;
}

}  // namespace isobrick
