#include "isobrick/preprocess/sources/length_units.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <string_view>

#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// As headers spell them, in small letters and without the s of many; in millimetres.
struct LengthName {
  std::string_view name;
  LengthScale scale;
};
constexpr LengthScale kPicometre{1, 1e9}, kNanometre{1, 1e6}, kMicrometre{1, 1e3}, kMillimetre,
    kCentimetre{10, 1}, kMetre{1e3, 1}, kAngstrom{1, 1e7}, kInch{25.4, 1};
constexpr LengthName kLengths[] = {
    {"picometre", kPicometre},  // of grids that isobrick wrote as .vdb
    {"nm", kNanometre},
    {"nanometer", kNanometre},
    {"nanometre", kNanometre},
    {"um", kMicrometre},
    {"\xC2\xB5m", kMicrometre},  // the sign for micro
    {"\xCE\xBCm", kMicrometre},  // the Greek letter
    {"\xB5m", kMicrometre},      // Latin-1
    {"\\u00b5m", kMicrometre},   // of ImageJ
    {"micrometer", kMicrometre},
    {"micrometre", kMicrometre},
    {"micron", kMicrometre},
    {"mm", kMillimetre},
    {"millimeter", kMillimetre},
    {"millimetre", kMillimetre},
    {"cm", kCentimetre},
    {"centimeter", kCentimetre},
    {"centimetre", kCentimetre},
    {"m", kMetre},
    {"meter", kMetre},
    {"metre", kMetre},
    {"angstrom", kAngstrom},
    {"\xC3\x85", kAngstrom},      // the letter
    {"\xE2\x84\xAB", kAngstrom},  // the sign
    {"\\u00c5", kAngstrom},       // of ImageJ
    {"\xC3\x85ngstrom", kAngstrom},
    {"\xC3\xA5ngstrom", kAngstrom},
    {"\xC3\x85ngstr\xC3\xB6m", kAngstrom},
    {"\xC3\xA5ngstr\xC3\xB6m", kAngstrom},
    {"inch", kInch},
    {"inche", kInch},  // of inches
    {"in", kInch}};

std::string trimmedUnit(std::string_view unit) {
  constexpr std::string_view kBlanks(" \t\0", 3);
  const std::size_t first = std::min(unit.find_first_not_of(kBlanks), unit.size());
  return std::string(unit.substr(first, unit.find_last_not_of(kBlanks) + 1 - first));
}

}  // namespace

std::optional<LengthScale> lengthScale(const std::string& unit) {
  const std::string symbol = trimmedUnit(unit);
  std::string name = lowercase(symbol);
  if (name.size() > 2 && name.back() == 's') name.pop_back();
  // A symbol in other letters is another one: Mm are megametres.
  constexpr std::size_t kLongestSymbol = 2;
  for (const LengthName& length : kLengths)
    if (length.name == (symbol.size() > kLongestSymbol ? name : symbol)) return length.scale;
  return std::nullopt;
}

void takeLengthUnits(const std::array<std::string, 3>& units, GridGeometry& geometry,
                     std::vector<std::string>& notes) {
  geometry.unit = LengthUnit::kUnknown;
  if (units == std::array<std::string, 3>{}) return;
  std::string names;
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (!units[axis].empty() && std::find(units.begin(), units.begin() + axis, units[axis]) ==
                                    units.begin() + static_cast<std::ptrdiff_t>(axis))
      names += (names.empty() ? "" : ", ") + quotedText(units[axis], 40);
  std::array<LengthScale, 3> scales;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto scale = lengthScale(units[axis]);
    if (!scale) {
      notes.push_back("lengths are as in the file and their unit is unknown: it says " + names +
                      (units[axis].empty() ? std::string(", and of ") + "xyz"[axis] + " nothing"
                                           : ", which is not all a length"));
      return;
    }
    scales[axis] = *scale;
  }
  geometry.unit = LengthUnit::kMillimetre;
  if (scales == std::array<LengthScale, 3>{}) return;
  // The steps of an oblique grid go along several of the world's axes.
  const bool is_one_scale = scales[1] == scales[0] && scales[2] == scales[0];
  const bool keeps_directions = is_one_scale || geometry.direction == glm::dmat3(1.0);
  for (int axis = 0; axis < 3; ++axis) {
    const LengthScale& scale = scales[static_cast<std::size_t>(axis)];
    geometry.origin[axis] = scale.of(geometry.origin[axis]);
    if (keeps_directions) {
      geometry.spacing[axis] = scale.of(geometry.spacing[axis]);
      continue;
    }
    glm::dvec3 step = geometry.direction[axis] * geometry.spacing[axis];
    for (int row = 0; row < 3; ++row)
      step[row] = scales[static_cast<std::size_t>(row)].of(step[row]);
    geometry.spacing[axis] = glm::length(step);
    if (geometry.spacing[axis] > 0) geometry.direction[axis] = step / geometry.spacing[axis];
  }
  notes.push_back("lengths were scaled from " + names + " to millimetres");
}

}  // namespace isobrick
