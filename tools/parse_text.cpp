#include "tools/parse_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include "isobrick/storage/length_scale.h"

namespace isobrick {
namespace {

[[noreturn]] void refuse(const std::string& text, std::string_view expected) {
  throw std::invalid_argument(fmt::format("'{}' is not {}", text, expected));
}

// from_chars takes no leading plus sign, but users may write one.
template <typename T>
bool parseWhole(std::string_view text, T& value) {
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && stop == end;
}

bool parseFinite(std::string_view text, double& value) {
  return parseWhole(text, value) && std::isfinite(value);
}

// Parses "a,b,c" with `parse(part, values[i])`; false if a part is bad or the count differs.
template <typename T, std::size_t count, typename Parse>
bool parseList(std::string_view text, std::array<T, count>& values, Parse parse) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t comma = text.find(',');
    if ((comma == std::string_view::npos) != (i + 1 == count)) return false;
    if (!parse(text.substr(0, comma), values[i])) return false;
    if (comma != std::string_view::npos) text.remove_prefix(comma + 1);
  }
  return true;
}

struct ColorName {
  std::string_view name, hexadecimal;
};
// Of CSS.
constexpr ColorName kColorNames[] = {
    {"black", "#000000"},  {"white", "#ffffff"}, {"grey", "#808080"},  {"gray", "#808080"},
    {"red", "#ff0000"},    {"green", "#008000"}, {"blue", "#0000ff"},  {"yellow", "#ffff00"},
    {"orange", "#ffa500"}, {"cyan", "#00ffff"},  {"brown", "#a52a2a"}, {"magenta", "#ff00ff"},
    {"purple", "#800080"}, {"pink", "#ffc0cb"},  {"ivory", "#fffff0"}, {"tan", "#d2b48c"}};

}  // namespace

std::string takeUnitName(std::string& text) {
  const std::size_t end = text.find_last_of("0123456789.") + 1;
  std::string unit = text.substr(end);
  if (!lengthScale(unit)) return {};
  text.resize(end);
  return unit;
}

std::optional<double> takeLengthUnit(std::string& text) {
  const auto scale = lengthScale(takeUnitName(text));
  return scale ? std::optional(scale->of(1)) : std::nullopt;
}

std::string parseLengthUnit(const std::string& text) {
  if (!lengthScale(text)) refuse(text, "a unit of length: it may be nm, um, mm, cm, m, inch or ft");
  return text;
}

double parseNumber(const std::string& text) {
  double value = 0;
  if (!parseFinite(text, value)) refuse(text, "a number");
  return value;
}

double parseNumberFrom(const std::string& text, double least) {
  const double value = parseNumber(text);
  if (!(value >= least)) refuse(text, fmt::format("a number of at least {}", least));
  return value;
}

double parseSingle(const std::string& text) {
  const double value = parseNumber(text);
  if (std::abs(value) > std::numeric_limits<float>::max())
    refuse(text, "within the range of single precision");
  return value;
}

std::int64_t parseInteger(const std::string& text, std::int64_t least, std::int64_t most) {
  std::int64_t value = 0;
  if (!parseWhole<std::int64_t>(text, value) || value < least || value > most)
    refuse(text, most == std::numeric_limits<std::int64_t>::max()
                     ? fmt::format("a whole number of at least {}", least)
                     : fmt::format("a whole number from {} to {}", least, most));
  return value;
}

glm::dvec3 parsePoint(const std::string& text) {
  std::array<double, 3> v{};
  if (!parseList(text, v, parseFinite)) refuse(text, "three numbers X,Y,Z without spaces");
  return {v[0], v[1], v[2]};
}

Index3 parseIndex3(const std::string& text) {
  std::array<std::int64_t, 3> v{};
  if (!parseList(text, v, parseWhole<std::int64_t>))
    refuse(text, "three whole numbers X,Y,Z without spaces");
  return {v[0], v[1], v[2]};
}

std::vector<double> parseNumbers(const std::string& text) {
  std::vector<double> numbers;
  for (std::size_t begin = 0, end = 0; end != std::string::npos; begin = end + 1) {
    end = text.find(',', begin);
    numbers.push_back(parseNumber(text.substr(begin, end - begin)));
  }
  return numbers;
}

std::uint64_t parseByteSize(const std::string& text) {
  constexpr std::string_view kExpected = "a size in bytes such as 65536, 256M or 1.5G";
  std::string lower = text;
  std::ranges::transform(lower, lower.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  std::string_view digits = lower;
  double unit = 1;
  constexpr std::string_view kUnits = "kmgt";
  const auto hasUnitBefore = [&](std::string_view bytes) {
    return digits.size() > bytes.size() && digits.ends_with(bytes) &&
           kUnits.find(digits[digits.size() - bytes.size() - 1]) != std::string_view::npos;
  };
  for (const std::string_view bytes : {"ib", "b"})  // 256MiB, 256MB and 256M are one size
    if (hasUnitBefore(bytes)) {
      digits.remove_suffix(bytes.size());
      break;
    }
  if (!digits.empty())
    if (const std::size_t power = kUnits.find(digits.back()); power != std::string_view::npos) {
      unit = std::exp2(10 * static_cast<double>(power + 1));
      digits.remove_suffix(1);
    }
  double value = 0;
  if (!parseFinite(digits, value)) refuse(text, kExpected);
  const double bytes = std::floor(value * unit);
  if (!(bytes >= 1 && bytes < 0x1p63) || (unit == 1 && bytes != value)) refuse(text, kExpected);
  return static_cast<std::uint64_t>(bytes);
}

Corners parseCorners(const std::string& text) {
  std::array<double, 6> v{};
  if (!parseList(text, v, parseFinite))
    refuse(text, "six numbers X0,Y0,Z0,X1,Y1,Z1 without spaces");
  const Corners corners{{v[0], v[1], v[2]}, {v[3], v[4], v[5]}};
  for (int axis = 0; axis < 3; ++axis)
    if (!(corners.lower[axis] < corners.upper[axis]))
      refuse(text, "a box: the first corner must be below the second on every axis");
  return corners;
}

PixelSize parsePixelSize(const std::string& text) {
  const std::string_view all = text;
  const std::size_t cross = all.find('x');
  PixelSize size;
  if (cross == std::string_view::npos || !parseWhole(all.substr(0, cross), size.width) ||
      !parseWhole(all.substr(cross + 1), size.height) || size.width < 1 || size.height < 1)
    refuse(text, "a size in pixels such as 1024x768");
  return size;
}

PixelSize PrintSize::pixels(double per_inch) const {
  const double scale = in_millimetres ? per_inch / 25.4 : 1.0;
  // Beyond what is drawn, which then says so.
  const auto whole = [&](double length) {
    return static_cast<int>(std::lround(std::clamp(scale * length, 1.0, 1e6)));
  };
  return {whole(width), whole(height)};
}

PrintSize parsePrintSize(const std::string& text) {
  constexpr std::string_view kUnit = "mm";
  if (text.size() <= kUnit.size() ||
      text.compare(text.size() - kUnit.size(), kUnit.size(), kUnit)) {
    const PixelSize pixels = parsePixelSize(text);
    return {static_cast<double>(pixels.width), static_cast<double>(pixels.height), false};
  }
  const std::string lengths = text.substr(0, text.size() - kUnit.size());
  const std::size_t cross = lengths.find('x');
  if (cross == std::string::npos) refuse(text, "a size in millimetres such as 85x60mm");
  PrintSize size{parseNumber(lengths.substr(0, cross)), parseNumber(lengths.substr(cross + 1)),
                 true};
  if (!(size.width > 0.0 && size.height > 0.0))
    refuse(text, "a size in millimetres such as 85x60mm");
  return size;
}

glm::vec3 parseColor(const std::string& text) {
  std::string_view word = text;
  for (const auto& [name, hexadecimal] : kColorNames)
    if (word == name) word = hexadecimal;
  if (std::uint32_t rgb = 0; word.size() == 7 && word.front() == '#') {
    const auto [stop, error] = std::from_chars(word.data() + 1, word.data() + 7, rgb, 16);
    if (error == std::errc() && stop == word.data() + 7)
      return glm::vec3(rgb >> 16, rgb >> 8 & 255, rgb & 255) / 255.0f;
  }
  std::array<double, 3> v{};
  bool fits = parseList(text, v, parseFinite);
  for (const double part : v) fits = fits && part >= 0 && part <= 1;
  if (!fits)
    refuse(text, "a colour: #rrggbb, R,G,B from 0 to 1 without spaces, or a name such as red");
  return glm::vec3(glm::dvec3(v[0], v[1], v[2]));
}

std::uint64_t parseLabel(const std::string& text) {
  std::uint64_t label = 0;
  const char* const end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, label);
  if (read.ec != std::errc() || read.ptr != end)
    refuse(text, "a label, a whole number from 0 to 18446744073709551615");
  return label;
}

std::vector<std::uint64_t> parseLabels(const std::string& text) {
  std::vector<std::uint64_t> labels;
  for (std::size_t begin = 0, end = 0; end != std::string::npos; begin = end + 1) {
    end = text.find(',', begin);
    labels.push_back(parseLabel(text.substr(begin, end - begin)));
    if (std::count(labels.begin(), labels.end(), labels.back()) > 1)
      throw std::invalid_argument("'" + text + "' names a label twice; leave one out");
  }
  return labels;
}

ShareNumber parseShare(const std::string& text) {
  const std::size_t slash = text.find('/');
  if (slash == std::string::npos)
    throw std::invalid_argument("'" + text + "' is not I/N, such as 3/8");
  const auto of = parseInteger(text.substr(slash + 1), 1, kMostShares);
  return {static_cast<std::uint32_t>(parseInteger(text.substr(0, slash), 1, of)),
          static_cast<std::uint32_t>(of)};
}

}  // namespace isobrick
