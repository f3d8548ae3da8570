#include "isobrick/preprocess/export/atomic_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const std::string& path, int error) {
  const bool may_pass = error == ENOSPC || error == EDQUOT || error == EIO;
  const std::string line = "cannot write '" + path + "': " + std::strerror(error) +
                           (may_pass ? "; free some space or choose another folder"
                                     : "; choose a folder that you may write to");
  if (may_pass) throw ResumableError(line, {.path = path});
  throw Error(line, {.path = path});
}

std::string withoutSlash(std::string path) {
  while (path.size() > 1 && path.back() == '/') path.pop_back();
  return path;
}

}  // namespace

AtomicFolder::AtomicFolder(const std::string& path, const std::string& temporary_path)
    : path_(path), temporary_path_(temporary_path) {}

// The other constructor has ended when this one begins, so the destructor removes the temporary
// folder if anything fails from here on.
AtomicFolder::AtomicFolder(const std::string& path)
    : AtomicFolder(withoutSlash(path), withoutSlash(path) + kTemporaryEnding) {
  std::error_code ignored;
  const auto status = fs::symlink_status(path_, ignored);
  if (fs::exists(status) && !fs::is_directory(status))
    throw unwritable(path_, "it exists and is no folder; choose another name");
  const bool is_new = mkdir(temporary_path_.c_str(), 0777) == 0;
  if (!is_new && errno != EEXIST) fail(path_, errno);
  fd_ = open(temporary_path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
  if (fd_ < 0) {
    const int error = errno;
    if (is_new) rmdir(temporary_path_.c_str());
    fail(path_, error);
  }
  if (flock(fd_, LOCK_EX | LOCK_NB) != 0) {
    ::close(fd_);
    fd_ = -1;
    throw unwritable(path_, "another process is writing '" + temporary_path_ +
                                "'; wait for it or choose another name");
  }
  for (const auto& entry : fs::directory_iterator(temporary_path_, ignored))
    fs::remove_all(entry.path(), ignored);
}

AtomicFolder::~AtomicFolder() {
  if (fd_ < 0) return;
  std::error_code ignored;
  fs::remove_all(temporary_path_, ignored);
  ::close(fd_);
}

void AtomicFolder::makeFolder(const std::string& name) {
  std::error_code error;
  fs::create_directories(fs::path(temporary_path_) / name, error);
  if (error) fail(path_, error.value());
}

void AtomicFolder::writeFile(const std::string& name, const void* data, std::size_t bytes) {
  const std::string path = temporary_path_ + "/" + name;
  const int fd = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) fail(path_, errno);
  const char* at = static_cast<const char*>(data);
  while (bytes > 0) {
    const ssize_t written = ::write(fd, at, std::min(bytes, std::size_t{1} << 30));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      const int error = written < 0 ? errno : ENOSPC;
      ::close(fd);
      fail(path_, error);
    }
    at += written;
    bytes -= static_cast<std::size_t>(written);
  }
  if (::close(fd) != 0) fail(path_, errno);
}

void AtomicFolder::commit(const CancelFlag* cancel) {
  if (cancel != nullptr) cancel->check();
  // One call for thousands of files: an fsync each would wait for the disk that often.
  if (syncfs(fd_) != 0) fail(path_, errno);
  if (cancel != nullptr) cancel->check();
  bool is_exchanged = false;
  if (std::rename(temporary_path_.c_str(), path_.c_str()) != 0) {
    // A folder of that name that is not empty. Exchanging leaves no moment without one.
    is_exchanged =
        renameat2(AT_FDCWD, temporary_path_.c_str(), AT_FDCWD, path_.c_str(), RENAME_EXCHANGE) == 0;
    if (!is_exchanged) fail(path_, errno);
  }
  if (is_exchanged) {
    std::error_code ignored;
    fs::remove_all(temporary_path_, ignored);
  }
  syncfs(fd_);  // the name
  ::close(fd_);
  fd_ = -1;
}

}  // namespace isobrick
