#include "tools/view/preview_folder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <system_error>

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPreviewFolderName = "isobrick-preview-";

fs::path placeForPreviews() {
  const char* const of_session = std::getenv("XDG_RUNTIME_DIR");
  for (const char* const place : {of_session, "/dev/shm"})
    if (place != nullptr && place[0] == '/' && access(place, W_OK | X_OK) == 0) return place;
  std::error_code ignored;
  return fs::temp_directory_path(ignored);
}

bool isOfLivingProcess(std::string_view name) {
  name.remove_prefix(kPreviewFolderName.size());
  pid_t process = 0;
  const auto read = std::from_chars(name.data(), name.data() + name.size(), process);
  return read.ec != std::errc() || process <= 0 || kill(process, 0) == 0 || errno != ESRCH;
}

// What is another user's cannot be removed.
void removeLeftPreviews(const fs::path& place) {
  std::error_code ignored;
  for (fs::directory_iterator entry(place, ignored), end; !ignored && entry != end;
       entry.increment(ignored)) {
    const std::string name = entry->path().filename().string();
    if (name.rfind(kPreviewFolderName, 0) != 0 || isOfLivingProcess(name)) continue;
    std::error_code not_ours;
    fs::remove_all(entry->path(), not_ours);
  }
}

}  // namespace

PreviewFolder::PreviewFolder() {
  const fs::path place = placeForPreviews();
  removeLeftPreviews(place);
  std::string name = (place / fmt::format("{}{}-XXXXXX", kPreviewFolderName, getpid())).string();
  if (mkdtemp(name.data()) != nullptr) path_ = name;
}

PreviewFolder::~PreviewFolder() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

}  // namespace isobrick
