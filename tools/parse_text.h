// Numbers as users write them on a command line: the same in every locale, and the whole word
// counts ("12x", "nan" and "" are refused).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"
#include "isobrick/storage/share_number.h"

namespace isobrick {

// All throw std::invalid_argument with the fault and the expected form.

// A finite number: 500, -1.5, 2e-3.
double parseNumber(const std::string& text);
// The same, at least `least`.
double parseNumberFrom(const std::string& text, double least);
// A number that single precision, in which voxels are compared, can hold.
double parseSingle(const std::string& text);
// A whole number within [least, most].
std::int64_t parseInteger(const std::string& text, std::int64_t least, std::int64_t most);
// Parsers with these bounds.
inline auto numberFrom(double least) {
  return [least](const std::string& text) { return parseNumberFrom(text, least); };
}
inline auto integerWithin(std::int64_t least, std::int64_t most) {
  return [least, most](const std::string& text) { return parseInteger(text, least, most); };
}
// Takes the unit off the end of lengths, "75,30,75mm" or "500um": its name, or its millimetres.
// Empty: there is none.
std::string takeUnitName(std::string& text);
std::optional<double> takeLengthUnit(std::string& text);
// A name that lengthScale() knows.
std::string parseLengthUnit(const std::string& text);
// "X,Y,Z"
glm::dvec3 parsePoint(const std::string& text);
Index3 parseIndex3(const std::string& text);
// "1,2.5,-3": any number of finite numbers, at least one.
std::vector<double> parseNumbers(const std::string& text);
// "65536", "256M", "256MiB", "1.5G": K, M, G and T stand for powers of 1024.
std::uint64_t parseByteSize(const std::string& text);

// A label, 0 to 2^64 - 1.
std::uint64_t parseLabel(const std::string& text);
// "3,7"
std::vector<std::uint64_t> parseLabels(const std::string& text);

// "3/8"
ShareNumber parseShare(const std::string& text);

// A closed box as its two corners.
struct Corners {
  glm::dvec3 lower{0.0};
  glm::dvec3 upper{0.0};
};
inline Corners operator*(const Corners& box, double scale) {
  return {box.lower * scale, box.upper * scale};
}
// "X0,Y0,Z0,X1,Y1,Z1" with every lower coordinate below its upper one.
Corners parseCorners(const std::string& text);

// A picture's size in pixels.
struct PixelSize {
  int width = 0;
  int height = 0;
};
// "1024x768"
PixelSize parsePixelSize(const std::string& text);

// The same, or the size of a print in millimetres.
struct PrintSize {
  double width = 0.0;
  double height = 0.0;
  bool in_millimetres = false;

  // At so many pixels per inch, at least one.
  PixelSize pixels(double per_inch) const;
};
// "1024x768", "85x60mm"
PrintSize parsePrintSize(const std::string& text);
// "#rrggbb", "R,G,B", each 0 .. 1, or a name of CSS such as "red"; sRGB.
glm::vec3 parseColor(const std::string& text);

}  // namespace isobrick
