// The words of a line that another program prints.
#pragma once

#include <charconv>
#include <string>
#include <string_view>

namespace isobrick {

// Takes a word and the space behind it off the line; false if it begins with another one.
inline bool takeWord(std::string_view& line, std::string_view word) {
  if (line.substr(0, word.size()) != word || line.substr(word.size(), 1) != " ") return false;
  line.remove_prefix(word.size() + 1);
  return true;
}

// The same for a number.
template <typename T>
bool takeNumber(std::string_view& line, T& number) {
  const auto read = std::from_chars(line.data(), line.data() + line.size(), number);
  if (read.ec != std::errc()) return false;
  return takeWord(line, line.substr(0, static_cast<std::size_t>(read.ptr - line.data())));
}

// Line breaks and other control characters become spaces.
inline std::string oneLine(std::string_view text) {
  std::string line(text);
  for (char& c : line)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

}  // namespace isobrick
