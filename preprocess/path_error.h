// Errors of a file, in the words that all sources and writers use.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

// "cannot use 'PATH': WHY": the file is whole, but cannot be used.
inline Error unusable(const std::string& path, const std::string& why,
                      std::vector<Remedy> remedies = {}) {
  return Error("cannot use '" + path + "': " + why, {.path = path}, std::move(remedies));
}
// "cannot read 'PATH': WHY"
inline Error unreadable(const std::string& path, const std::string& why,
                        std::vector<Remedy> remedies = {}) {
  return Error("cannot read '" + path + "': " + why, {.path = path}, std::move(remedies));
}
// "cannot write 'PATH': WHY"
inline Error unwritable(const std::string& path, const std::string& why,
                        std::vector<Remedy> remedies = {}) {
  return Error("cannot write '" + path + "': " + why, {.path = path}, std::move(remedies));
}

}  // namespace isobrick
