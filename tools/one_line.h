// Text from anywhere (paths, files, libraries) as a single line that cannot move the cursor.
#pragma once

#include <string>
#include <string_view>

namespace isobrick {

// Line breaks and other control characters become spaces.
inline std::string oneLine(std::string_view text) {
  std::string line(text);
  for (char& c : line)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

}  // namespace isobrick
