#include "isobrick/viewer/state/input_event.h"

#include <algorithm>

namespace isobrick {

std::optional<Key> keyNamed(std::string_view name) {
  const auto found = std::find(kKeyNames.begin() + 1, kKeyNames.end(), name);
  if (found == kKeyNames.end()) return std::nullopt;
  return static_cast<Key>(found - kKeyNames.begin());
}

Key letterKey(std::string_view name, char us_letter) {
  const bool is_plain = name.size() == 1 && static_cast<unsigned char>(name[0]) < 128;
  char letter = us_letter;
  if (is_plain)
    letter = name[0] >= 'a' && name[0] <= 'z' ? static_cast<char>(name[0] - 32) : name[0];
  if (letter < 'A' || letter > 'Z') return Key::kNone;
  return static_cast<Key>(static_cast<int>(Key::kA) + letter - 'A');
}

}  // namespace isobrick
