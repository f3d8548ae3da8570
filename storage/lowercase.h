// Names that may be written in any case.
#pragma once

#include <cctype>
#include <filesystem>
#include <string>

namespace isobrick {

inline std::string lowercase(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

// ".nrrd" of "scans/Head.NRRD"; "" if there is none.
inline std::string lowerExtension(const std::filesystem::path& path) {
  return lowercase(path.extension().string());
}

}  // namespace isobrick
