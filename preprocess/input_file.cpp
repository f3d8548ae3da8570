#include "isobrick/preprocess/input_file.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

// The file, or the nearest folder above it that exists by name, if that is a link to nowhere.
std::optional<std::filesystem::path> linkToNowhere(std::filesystem::path path) {
  for (; !path.empty(); path = path.parent_path()) {
    struct stat status = {};
    if (lstat(path.c_str(), &status) == 0) {
      const bool leads_nowhere = S_ISLNK(status.st_mode) && stat(path.c_str(), &status) != 0;
      return leads_nowhere ? std::optional(path) : std::nullopt;
    }
    if (errno != ENOENT || path == path.parent_path()) break;
  }
  return std::nullopt;
}

// `name` is its name in the message.
[[noreturn]] void refuseToOpen(const std::string& path, const std::string& name, int reason) {
  const std::string cannot = "cannot open " + name + ": ";
  if (reason == ENOENT)
    if (const auto link = linkToNowhere(path)) {
      const std::string target = linkTarget(*link).string();
      throw fileError(
          path, cannot, *link == path ? "it" : "'" + link->string() + "'", " is a link to '",
          target,
          "', which is not there; fetch the file (git annex get, datalad get) or mend the link");
    }
  const std::string why = std::strerror(reason);
  if (reason == EACCES || reason == EPERM)
    throw fileError(path, cannot, why, "; change its permissions");
  if (reason == EIO || reason == ESTALE || reason == ETIMEDOUT)
    throw ResumableError(cannot + why + "; check the disk or its server, then run again",
                         {.path = path});
  throw fileError(path, cannot, why, "; check the path");
}

}  // namespace

bool inputIsThere(const std::string& path) {
  struct stat status = {};
  if (stat(path.c_str(), &status) == 0) return true;
  const int reason = errno;
  if (reason == ENOENT && !linkToNowhere(path)) return false;
  refuseToOpen(path, "'" + path + "'", reason);
}

// Without O_NONBLOCK the call would wait for a pipe; it has no effect on regular files.
InputFile::InputFile(const std::string& path, const std::string& named_by)
    : path_(path), file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
  const std::string name =
      "'" + path + "'" + (named_by.empty() ? "" : ", which '" + named_by + "' names");
  if (file_.get() < 0) refuseToOpen(path, name, errno);
  struct stat status = {};
  if (fstat(file_.get(), &status) != 0 || !S_ISREG(status.st_mode))
    throw fileError(path, "cannot read ", name, ": it is not a regular file; copy it to one");
  size_ = static_cast<std::uint64_t>(status.st_size);
  changed_at_ = status.st_mtim;
  posix_fadvise(file_.get(), 0, 0, POSIX_FADV_SEQUENTIAL);
}

std::size_t InputFile::readAt(std::uint64_t offset, void* out, std::size_t bytes) const {
  const IoResult result = readBytesAt(file_.get(), offset, out, bytes);
  if (result.error != 0)
    throw ResumableError("cannot read '" + path_ + "' " + ioFailureText(offset, result) +
                             "; check the disk, then run again",
                         {.path = path_, .offset = offset + result.bytes});
  return result.bytes;
}

}  // namespace isobrick
