// Numbers out of text and into it, whatever the locale.
#pragma once

#include <charconv>
#include <optional>
#include <string>
#include <string_view>

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

}  // namespace isobrick
