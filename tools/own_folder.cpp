#include "tools/own_folder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

char** the_words = nullptr;

}  // namespace

std::filesystem::path ownExecutable() { return linkTarget("/proc/self/exe"); }

std::filesystem::path ownFolder() { return ownExecutable().parent_path(); }

std::optional<std::string> findOwn(const std::string& name, int access_mode) {
  for (const std::filesystem::path& folder : {ownFolder(), ownFolder() / ISOBRICK_LIBEXEC_FROM_BIN})
    if (access((folder / name).c_str(), access_mode) == 0) return (folder / name).string();
  return std::nullopt;
}

std::string requireOwn(const std::string& name, int access_mode) {
  if (const auto found = findOwn(name, access_mode)) return *found;
  throw Error(fmt::format("cannot find '{}' beside '{}' or in '{}'; install isobrick again", name,
                          ownExecutable().string(),
                          (ownFolder() / ISOBRICK_LIBEXEC_FROM_BIN).lexically_normal().string()));
}

void noteWords(char** words) { the_words = words; }

void becomeExecutable(const std::string& name) {
  const std::string path = requireOwn(name);
  execv(path.c_str(), the_words);
  throw Error(
      fmt::format("cannot run '{}': {}; install isobrick again", path, std::strerror(errno)));
}

}  // namespace isobrick
