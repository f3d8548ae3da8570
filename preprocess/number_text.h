// Numbers out of text and into it, whatever the locale.
#pragma once

#include <charconv>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

#include "isobrick/storage/grid.h"

namespace isobrick {

// The number that all of the text is.
template <typename T>
std::optional<T> numberIn(std::string_view text) {
  T number{};
  const char* const end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, number);
  if (result.ec != std::errc() || result.ptr != end) return std::nullopt;
  return number;
}

// At most six digits: for notes.
inline std::string shortText(double number) {
  char digits[32];
  return {digits,
          std::to_chars(digits, digits + sizeof digits, number, std::chars_format::general, 6).ptr};
}

// The parts one behind the other: texts, characters, whole numbers in full, others as shortText().
template <typename... Parts>
std::string concat(const Parts&... parts) {
  std::string text;
  const auto append = [&](const auto& part) {
    using Part = std::decay_t<decltype(part)>;
    if constexpr (std::is_floating_point_v<Part>)
      text += shortText(static_cast<double>(part));
    else if constexpr (std::is_integral_v<Part> && !std::is_same_v<Part, char>)
      text += std::to_string(part);
    else
      text += part;
  };
  (append(parts), ...);
  return text;
}

// Shortest text that reads back as the same double.
std::string numberText(double number);

// "1,2,3", or with another separator.
std::string indexText(const Index3& v, const char* separator = ",");
std::string pointText(const glm::dvec3& v, const char* separator = ",");

// "#0080ff" for 0x0080ff, and the inverse, with or without '#'; nothing for other texts.
std::string hexColorText(std::uint32_t color);
std::optional<std::uint32_t> parseHexColor(std::string text);

struct NumberedName {
  std::string before, after;
  std::size_t width = 0;  // at least so many characters
  char fill = ' ';

  std::string of(std::int64_t number) const;
  // Whether it is the name of some number that is not negative, however it is filled up.
  bool matches(const std::string& name) const;
};

// As printf takes it: one %d or %i, perhaps with a width of up to 99 characters, which a 0 before
// it fills with zeros. Nothing for all other texts.
std::optional<NumberedName> parseNumberedName(const std::string& text);

// Files that lie in a folder of their own.
struct NumberedFiles {
  std::string folder;
  NumberedName name;  // filled up with zeros, so that names sort as their numbers do
};
// "folder/%04d.tif"; nothing if there is no folder, or not one place for a number, in the last part
// of the path.
std::optional<NumberedFiles> parseNumberedFiles(const std::string& path);

}  // namespace isobrick
