#include "isobrick/viewer/state/view_pieces.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <glm/geometric.hpp>

#include "isobrick/viewer/state/short_number.h"

namespace isobrick {
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
