// Names and settings that may be written in any case, and with blanks around them.
#pragma once

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <string>
#include <string_view>

namespace isobrick {

inline std::string lowercase(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

// ".nrrd" of "scans/Head.NRRD"; "" if there is none.
inline std::string lowerExtension(const std::filesystem::path& path) {
  return lowercase(path.extension().string());
}

// Without the blanks around it; a view into `text`.
inline std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r\n";
  text.remove_prefix(std::min(text.find_first_not_of(kBlanks), text.size()));
  return text.substr(0, text.find_last_not_of(kBlanks) + 1);
}

}  // namespace isobrick
