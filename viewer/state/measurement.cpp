#include "isobrick/viewer/state/measurement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>

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

namespace {

std::string numberText(const char* form, double number) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), form, number);
  return text.data();
}

void boundSeeds(std::vector<ComponentSeed>& seeds) {
  if (seeds.size() > kMostSeeds) seeds.resize(kMostSeeds);
  for (ComponentSeed& seed : seeds) seed.area = std::max(seed.area, 0.0);
}

}  // namespace

void keepOnly(const ComponentSeed& piece, PieceChoice& choice) {
  choice.keep = {piece};
  choice.hide.clear();
}

bool hide(const ComponentSeed& piece, PieceChoice& choice) {
  const bool was_kept = std::erase_if(choice.keep, [&](const ComponentSeed& kept) {
                          return kept.point == piece.point;
                        }) > 0;
  if (was_kept && !choice.keep.empty()) return true;
  if (choice.hide.size() >= kMostSeeds) return false;
  choice.hide.push_back(piece);
  return true;
}

PieceChoice bounded(const PieceChoice& choice) {
  PieceChoice result = choice;
  boundSeeds(result.keep);
  boundSeeds(result.hide);
  result.least_area = std::max(result.least_area, 0.0);
  return result;
}

ViewPieceMeasure measureOf(const SurfaceComponent& piece, double isovalue, int level) {
  return {isovalue,    level,       piece.area,   piece.volume,
          piece.lower, piece.upper, piece.center, piece.point};
}

std::string pieceText(const ViewPieceMeasure& piece, LengthUnit unit) {
  const bool is_mm = unit == LengthUnit::kMillimetre;
  std::string text = shortNumber(piece.area) + (is_mm ? " mm\u00b2" : "");
  if (piece.volume) {
    text += ", ";
    text += shortNumber(*piece.volume) + (is_mm ? " mm\u00b3" : "");
  }
  return text;
}

std::string pieceMeasuresCsv(const std::vector<ViewPieceMeasure>& pieces, std::size_t first,
                             LengthUnit unit) {
  const std::string length = unit == LengthUnit::kMillimetre ? "mm" : "";
  const auto power = [&](const char* exponent) {
    return length.empty() ? std::string() : length + exponent;
  };
  std::string csv;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const ViewPieceMeasure& piece = pieces[i];
    const glm::dvec3 extent = piece.upper - piece.lower;
    const auto line = [&](const char* kind, std::optional<double> value, const std::string& of) {
      csv += std::to_string(first + i);
      csv += kind;
      csv += value ? numberText(",%.9g,", *value) : std::string(",,");
      csv += of;
      for (const glm::dvec3& point : {piece.center, piece.lower, piece.upper})
        for (int axis = 0; axis < 3; ++axis) csv += numberText(",%.9g", point[axis]);
      csv += "\n";
    };
    line(",piece_area", piece.area, power("2"));
    line(",piece_volume", piece.volume, power("3"));
    line(",piece_extent_x", extent.x, length);
    line(",piece_extent_y", extent.y, length);
    line(",piece_extent_z", extent.z, length);
  }
  return csv;
}

}  // namespace isobrick
