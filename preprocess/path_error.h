// Errors of a file, in the words that all sources and writers use.
#pragma once

#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// The line of `parts` (see concat()), of which those of the type Remedy are its remedies.
template <typename... Parts>
Error fileError(const std::string& path, const Parts&... parts) {
  std::string line;
  std::vector<Remedy> remedies;
  const auto take = [&](const auto& part) {
    if constexpr (std::is_same_v<std::decay_t<decltype(part)>, Remedy>)
      remedies.push_back(part);
    else
      line += concat(part);
  };
  (take(parts), ...);
  return Error(line, {.path = path}, std::move(remedies));
}

// "cannot use 'PATH': WHY": the file is whole, but cannot be used.
template <typename... Parts>
Error unusable(const std::string& path, const Parts&... why) {
  return fileError(path, "cannot use '", path, "': ", why...);
}
// "cannot read 'PATH': WHY"
template <typename... Parts>
Error unreadable(const std::string& path, const Parts&... why) {
  return fileError(path, "cannot read '", path, "': ", why...);
}
// "cannot write 'PATH': WHY"
template <typename... Parts>
Error unwritable(const std::string& path, const Parts&... why) {
  return fileError(path, "cannot write '", path, "': ", why...);
}

}  // namespace isobrick
