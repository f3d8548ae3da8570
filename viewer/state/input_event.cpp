#include "isobrick/viewer/state/input_event.h"

#include <algorithm>

namespace isobrick {

std::optional<Key> keyNamed(std::string_view name) {
  const auto found = std::find(kKeyNames.begin() + 1, kKeyNames.end(), name);
  if (found == kKeyNames.end()) return std::nullopt;
  return static_cast<Key>(found - kKeyNames.begin());
}

}  // namespace isobrick
