#include "tools/own_folder.h"

#include <system_error>

namespace isobrick {

std::filesystem::path ownExecutable() {
  std::error_code unknown;
  return std::filesystem::read_symlink("/proc/self/exe", unknown);
}

std::filesystem::path ownFolder() { return ownExecutable().parent_path(); }

}  // namespace isobrick
