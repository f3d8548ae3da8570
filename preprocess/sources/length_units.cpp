#include "isobrick/preprocess/sources/length_units.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <string_view>

#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

struct MetrePrefix {
  std::string_view name, symbol;
  int exponent;  // of 10, in metres
};
constexpr MetrePrefix kPrefixes[] = {
    {"yotta", "Y", 24},  {"zetta", "Z", 21}, {"exa", "E", 18},    {"peta", "P", 15},
    {"tera", "T", 12},   {"giga", "G", 9},   {"mega", "M", 6},    {"kilo", "k", 3},
    {"hecto", "h", 2},   {"deca", "da", 1},  {"deka", "da", 1},   {"", "", 0},
    {"deci", "d", -1},   {"centi", "c", -2}, {"milli", "m", -3},  {"micro", "u", -6},
    {"nano", "n", -9},   {"pico", "p", -12}, {"femto", "f", -15}, {"atto", "a", -18},
    {"zepto", "z", -21}, {"yocto", "y", -24}};

// In millimetres.
struct OtherLength {
  std::string_view name;
  LengthScale scale;
};
constexpr OtherLength kOthers[] = {{"micron", {1, 1e3}},
                                   {"angstrom", {1, 1e7}},
                                   {"inch", {25.4, 1}},
                                   {"inche", {25.4, 1}},  // of inches
                                   {"in", {25.4, 1}},
                                   {"foot", {304.8, 1}},
                                   {"feet", {304.8, 1}},
                                   {"ft", {304.8, 1}},
                                   {"yard", {914.4, 1}},
                                   {"yd", {914.4, 1}},
                                   {"mile", {1609344, 1}},
                                   {"mi", {1609344, 1}},
                                   {"parsec", {3.0856775814913673e19, 1}},
                                   {"pc", {3.0856775814913673e19, 1}}};

LengthScale powerOfTen(int exponent) {
  const double power = std::pow(10.0, std::abs(exponent));
  return exponent < 0 ? LengthScale{1, power} : LengthScale{power, 1};
}

std::string replaced(const std::string& text, std::string_view from, std::string_view to) {
  std::string result;
  for (std::size_t at = 0;;) {
    const std::size_t found = text.find(from, at);
    result.append(text, at, found - at);
    if (found == std::string::npos) return result;
    result += to;
    at = found + from.size();
  }
}

// Letters that are written in several ways, as ASCII.
std::string plainName(std::string unit) {
  // The sign for micro, the Greek letter, Latin-1, and as ImageJ writes it down.
  for (const char* micro : {"\xC2\xB5", "\xCE\xBC", "\\u00B5", "\\u00b5", "\xB5"})
    unit = replaced(unit, micro, "u");
  // A with a ring: the letter and the sign; o with dots.
  for (const char* ring : {"\xC3\x85", "\xE2\x84\xAB", "\\u00C5", "\xC3\xA5"})
    unit = replaced(unit, ring, unit.size() <= 6 ? "angstrom" : "a");
  unit = replaced(unit, "\xC3\xB6", "o");
  const auto isBlank = [](char c) { return c == ' ' || c == '\t' || c == '\0'; };
  while (!unit.empty() && isBlank(unit.back())) unit.pop_back();
  unit.erase(0, static_cast<std::size_t>(std::find_if_not(unit.begin(), unit.end(), isBlank) -
                                         unit.begin()));
  return unit;
}

constexpr int kMillimetresOfMetre = 3;  // as a power of 10

}  // namespace

std::optional<LengthScale> lengthScale(const std::string& unit) {
  const std::string symbol = plainName(unit);
  for (const MetrePrefix& prefix : kPrefixes)
    if (symbol == std::string(prefix.symbol) + "m")
      return powerOfTen(prefix.exponent + kMillimetresOfMetre);
  std::string name = lowercase(symbol);
  if (name.size() > 2 && name.back() == 's') name.pop_back();
  for (const MetrePrefix& prefix : kPrefixes)
    for (const char* metre : {"meter", "metre"})
      if (name == std::string(prefix.name) + metre)
        return powerOfTen(prefix.exponent + kMillimetresOfMetre);
  for (const OtherLength& other : kOthers)
    if (name == other.name) return other.scale;
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
