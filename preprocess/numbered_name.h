// Names of files with one number in them: "slice%03d.raw".
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

namespace isobrick {

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

}  // namespace isobrick
