#include "isobrick/storage/name_of_hdf5.h"

#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

constexpr const char* kEndings[] = {".h5", ".hdf5", ".hdf", ".he5", ".nxs", ".nc", ".ims", ".mat"};

}  // namespace

std::pair<std::string, std::string> splitHdf5Name(const std::string& name) {
  for (const char* ending : kEndings) {
    if (lowercase(name).ends_with(ending)) return {name, ""};
    const std::size_t at = lowercase(name).rfind(std::string(ending) + ":/");
    if (at != std::string::npos) {
      const std::size_t colon = at + std::string(ending).size();
      return {name.substr(0, colon), name.substr(colon + 1)};
    }
  }
  return {name, ""};
}

bool isHdf5Name(const std::string& name) {
  const std::string file = lowercase(splitHdf5Name(name).first);
  for (const char* ending : kEndings)
    if (file.ends_with(ending)) return true;
  return false;
}

}  // namespace isobrick
