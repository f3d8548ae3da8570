#include "isobrick/preprocess/export/atomic_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

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
  if (isNameTaken(path_) && (isLink(path_) || !isFolder(path_)))
    throw unwritable(path_, "it exists and is no folder; choose another name");
  const bool is_new = mkdir(temporary_path_.c_str(), 0777) == 0;
  if (!is_new && errno != EEXIST) failWriting(path_, errno);
  fd_ = open(temporary_path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
  if (fd_ < 0) {
    const int error = errno;
    if (is_new) rmdir(temporary_path_.c_str());
    failWriting(path_, error);
  }
  struct stat status = {};
  if (!is_new && (fstat(fd_, &status) != 0 || status.st_uid != geteuid())) {
    ::close(std::exchange(fd_, -1));  // who owns it may change names in it at any time
    throw unwritable(path_, "'", temporary_path_,
                     "' is another user's; move it away or choose another name");
  }
  if (flock(fd_, LOCK_EX | LOCK_NB) != 0) {
    ::close(fd_);
    fd_ = -1;
    throw unwritable(path_, "another process is writing '", temporaryPath(),
                     "'; wait for it or choose another name");
  }
  visitFolder(temporary_path_, [](const FolderMember& left) {
    removeTree(left.path());
    return true;
  });
}

AtomicFolder::~AtomicFolder() {
  if (fd_ < 0) return;
  removeTree(temporary_path_);
  ::close(fd_);
}

void AtomicFolder::makeFolder(const std::string& name) {
  const std::error_code error = makeFolders(temporary_path_ / name);
  if (error) failWriting(path_, error.value());
}

AtomicFolder::File::File(const AtomicFolder& folder, const std::string& name)
    : folder_(folder),
      file_(open((folder.temporaryPath() + "/" + name).c_str(),
                 O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0666)) {
  if (file_.get() < 0) failWriting(folder_.path_, errno);
}

void AtomicFolder::File::append(const void* data, std::size_t bytes) {
  const IoResult result = writeNextBytes(file_.get(), data, bytes);
  if (result.error != 0) failWriting(folder_.path_, result.error);
}

void AtomicFolder::File::close() {
  if (::close(file_.release()) != 0) failWriting(folder_.path_, errno);
}

void AtomicFolder::writeFile(const std::string& name, const void* data, std::size_t bytes) {
  File file(*this, name);
  file.append(data, bytes);
  file.close();
}

void AtomicFolder::takeFile(const fs::path& from, const fs::path& name) {
  makeFolder(name.parent_path().string());
  const std::error_code error = linkOrCopyFile(from, temporary_path_ / name);
  if (error) failWriting(path_, error.value());
}

void AtomicFolder::commit(const CancelFlag* cancel) {
  if (cancel != nullptr) cancel->check();
  // One call for thousands of files: an fsync each would wait for the disk that often.
  if (syncfs(fd_) != 0) failWriting(path_, errno);
  if (cancel != nullptr) cancel->check();
  bool is_exchanged = false;
  if (std::rename(temporary_path_.c_str(), path_.c_str()) != 0) {
    // A folder of that name that is not empty. Exchanging leaves no moment without one.
    is_exchanged =
        renameat2(AT_FDCWD, temporary_path_.c_str(), AT_FDCWD, path_.c_str(), RENAME_EXCHANGE) == 0;
    if (!is_exchanged) failWriting(path_, errno);
  }
  ::close(std::exchange(fd_, -1));
  const int error = syncFolderOf(path_);
  // Only now: before, a loss of power could bring the old folder back, with some of it removed.
  if (is_exchanged) removeTree(temporary_path_);
  if (error != 0) failWriting(path_, error);
}

}  // namespace isobrick
