#include "isobrick/storage/length_scale.h"

#include <algorithm>
#include <string_view>

#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// As headers spell them, in small letters, without the s of many and with -er for -re; in
// millimetres.
struct LengthName {
  std::string_view name;
  LengthScale scale;
};
constexpr LengthScale kPicometre{1, 1e9}, kNanometre{1, 1e6}, kMicrometre{1, 1e3}, kMillimetre,
    kCentimetre{10, 1}, kMetre{1e3, 1}, kAngstrom{1, 1e7}, kInch{25.4, 1}, kFoot{304.8, 1};
constexpr LengthName kLengths[] = {
    {"picometer", kPicometre},  // of grids that isobrick wrote as .vdb
    {"nm", kNanometre},
    {"nanometer", kNanometre},
    {"um", kMicrometre},
    {"\xC2\xB5m", kMicrometre},  // the sign for micro
    {"\xCE\xBCm", kMicrometre},  // the Greek letter
    {"\xB5m", kMicrometre},      // Latin-1
    {"\\u00b5m", kMicrometre},   // of ImageJ
    {"micrometer", kMicrometre},
    {"micron", kMicrometre},
    {"mm", kMillimetre},
    {"millimeter", kMillimetre},
    {"cm", kCentimetre},
    {"centimeter", kCentimetre},
    {"m", kMetre},
    {"meter", kMetre},
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
    {"in", kInch},
    {"ft", kFoot},
    {"foot", kFoot},
    {"feet", kFoot}};

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
  if (name.ends_with("metre")) name.replace(name.size() - 2, 2, "er");
  // A symbol in other letters is another one: Mm are megametres.
  constexpr std::size_t kLongestSymbol = 2;
  for (const LengthName& length : kLengths)
    if (length.name == (symbol.size() > kLongestSymbol ? name : symbol)) return length.scale;
  return std::nullopt;
}

}  // namespace isobrick
