#include "isobrick/storage/atomic_file.h"

#include <fcntl.h>
#include <linux/magic.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statfs.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {
namespace {

// Writing to the disk begins after so many bytes: so the disk works while the next ones are made,
// and the fsync at the end has little left to do.
constexpr std::uint64_t kBytesPerWriteback = std::uint64_t{8} << 20;

const char* adviceFor(int error) {
  switch (error) {
    case ENOSPC:
    case EDQUOT:
      return "free some space or choose another folder";
    case ENOENT:
    case ENOTDIR:
      return "create the folder first or choose another one";
    case EACCES:
    case EPERM:
    case EROFS:
      return "choose a folder that you may write to";
    case EISDIR:
      return "it is a folder; name a file in it";
    case ENAMETOOLONG:
      return "choose a shorter name";
    case EFBIG:
      return "raise the limit on file sizes or choose another file system";
    default:
      return "check the disk or choose another folder";
  }
}

// True if `path` still names the file that is open as `fd`.
bool namesOpenFile(const std::string& path, int fd) {
  struct stat named = {}, opened = {};
  return stat(path.c_str(), &named) == 0 && fstat(fd, &opened) == 0 &&
         named.st_dev == opened.st_dev && named.st_ino == opened.st_ino;
}

// Opens and locks the temporary file, and empties it if `empty`. The lock distinguishes a leftover
// of a killed process from the file of a living one. Between open and lock the other process may
// have published the file; then this one must not empty it, and the next round makes a new one.
// Others who may write to the folder know the name too: what they put there is not used.
int openTemporary(const std::string& path, const std::string& temporary_path, bool empty,
                  mode_t mode) {
  constexpr int kFlags = O_RDWR | O_CLOEXEC | O_NOFOLLOW;
  for (;;) {
    int fd = open(temporary_path.c_str(), kFlags | O_CREAT | O_EXCL, mode);
    const bool is_left = fd < 0 && errno == EEXIST;
    if (is_left) fd = open(temporary_path.c_str(), kFlags);
    if (is_left && fd < 0 && errno == ENOENT) continue;
    if (fd < 0) failWriting(path, errno);
    struct stat status = {};
    if (fstat(fd, &status) != 0 || !S_ISREG(status.st_mode)) {  // a pipe or a device of that name
      close(fd);
      throw Error("cannot write '" + path + "': '" + temporary_path +
                      "' is there and is not a regular file; move it away or choose another name",
                  {.path = path});
    }
    const bool busy = flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    if (busy) {
      close(fd);
      throw Error("cannot write '" + path + "': another process is writing '" + temporary_path +
                      "'; wait for it or choose another name",
                  {.path = path});
    }
    if (!namesOpenFile(temporary_path, fd)) {
      close(fd);
      continue;
    }
    if (is_left && (status.st_uid != geteuid() || status.st_nlink != 1)) {
      close(fd);
      throw Error("cannot write '" + path + "': '" + temporary_path +
                      "' is another user's file or has a second name; move it away or choose "
                      "another name",
                  {.path = path});
    }
    if (empty && ftruncate(fd, 0) != 0) {
      const int error = errno;
      unlink(temporary_path.c_str());
      close(fd);
      failWriting(path, error);
    }
    return fd;
  }
}

}  // namespace

void failWriting(const std::string& path, int error, std::optional<std::uint64_t> offset) {
  const std::string line =
      "cannot write '" + path + "': " + std::strerror(error) + "; " + adviceFor(error);
  if (error == ENOSPC || error == EDQUOT || error == EFBIG || error == EIO)
    throw ResumableError(line, {.path = path, .offset = offset});
  throw Error(line, {.path = path, .offset = offset});
}

std::string folderOf(const std::string& path) {
  const std::size_t slash = path.find_last_of('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

int syncFolderOf(const std::string& path) {
  const OpenDescriptor folder(open(folderOf(path).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (folder.get() < 0 || fsync(folder.get()) == 0) return 0;
  return errno == EINVAL || errno == ENOTSUP ? 0 : errno;
}

AtomicFile::AtomicFile(const std::string& path, Leftover leftover, const char* temporary_ending)
    : path_(path), temporary_path_(path + temporary_ending) {
  // Renaming over a device or a folder would destroy it or fail after all the work.
  struct stat status = {};
  if (path.empty() || path.back() == '/') failWriting(path, EISDIR);
  const bool is_there = stat(path.c_str(), &status) == 0;
  if (is_there && !S_ISREG(status.st_mode)) {
    if (S_ISDIR(status.st_mode)) failWriting(path, EISDIR);
    throw Error("cannot write '" + path +
                    "': it exists and is not a regular file; choose another "
                    "name",
                {.path = path});
  }
  // A file that takes the place of another one is for the same people.
  const mode_t mode = is_there ? (status.st_mode & 0777) | 0600 : 0666;
  fd_ = openTemporary(path_, temporary_path_, leftover == Leftover::kEmpty, mode);
  if (is_there) fchmod(fd_, mode);
}

AtomicFile::~AtomicFile() { close(); }

void AtomicFile::close() noexcept {
  if (fd_ < 0) return;
  if (!keep_) unlink(temporary_path_.c_str());  // before close, which gives up the lock
  ::close(fd_);
  fd_ = -1;
}

void AtomicFile::write(const void* data, std::size_t bytes) {
  pwrite(data, bytes, position_);
  position_ += bytes;
}

void AtomicFile::pwrite(const void* data, std::size_t bytes, std::uint64_t offset) {
  const IoResult result = writeBytesAt(fd_, offset, data, bytes);
  if (result.error != 0) failWriting(path_, result.error, offset + result.bytes);
  beginWriteback(bytes);
}

void AtomicFile::writeGathered(std::span<iovec> spans) {
  const IoResult result = writeBytesAt(fd_, position_, spans);
  position_ += result.bytes;
  if (result.error != 0) failWriting(path_, result.error, position_);
  beginWriteback(result.bytes);
}

// Requests it without waiting; if that is not possible, fsync does all the work.
void AtomicFile::beginWriteback(std::uint64_t bytes) {
  if ((written_ += bytes) < kBytesPerWriteback) return;
  written_ = 0;
  sync_file_range(fd_, 0, 0, SYNC_FILE_RANGE_WRITE);
}

std::optional<std::uint64_t> AtomicFile::freeBytes() const {
  struct statvfs status = {};
  if (fstatvfs(fd_, &status) != 0 || status.f_blocks == 0) return std::nullopt;
  return static_cast<std::uint64_t>(status.f_bavail) * status.f_frsize;
}

void AtomicFile::reserve(std::uint64_t bytes, const CancelFlag* cancel) {
  if (cancel != nullptr) cancel->check();
  struct statfs status = {};
  if (fstatfs(fd_, &status) != 0 || status.f_type == TMPFS_MAGIC) return;
  // Some file systems take their time for many gigabytes.
  constexpr std::uint64_t kMostPerCall = std::uint64_t{4} << 30;
  for (std::uint64_t at = 0; at < bytes;) {
    if (cancel != nullptr) cancel->check();
    const std::uint64_t part = std::min(bytes - at, kMostPerCall);
    const int result = fallocate(fd_, 0, static_cast<off_t>(at), static_cast<off_t>(part));
    if (result != 0 && errno == EINTR) continue;
    if (result != 0 && (errno == EOPNOTSUPP || errno == ENOSYS)) return;
    if (result != 0) failWriting(path_, errno);
    at += part;
  }
}

void AtomicFile::cutAfterPosition() {
  if (ftruncate(fd_, static_cast<off_t>(position_)) != 0) failWriting(path_, errno);
}

// fsync does not return before all is written, which no signal changes; so the bytes are brought to
// the disk some of them at a time before it. A failure here would not be reported again by
// fsync.
void AtomicFile::drain(const CancelFlag& cancel) {
  constexpr std::uint64_t kStepBytes = std::uint64_t{4} << 20;
  constexpr std::uint64_t kStepsAhead = 4;  // that the disk has to do meanwhile
  struct stat status = {};
  if (fstat(fd_, &status) != 0) failWriting(path_, errno);
  const auto size = static_cast<std::uint64_t>(status.st_size);
  const auto sync = [&](std::uint64_t at, unsigned flags) {
    if (at >= size) return true;
    if (sync_file_range(fd_, static_cast<off_t>(at), static_cast<off_t>(kStepBytes), flags) == 0)
      return true;
    if (errno == EIO || errno == ENOSPC || errno == EDQUOT) failWriting(path_, errno);
    return errno == EINTR;
  };
  for (std::uint64_t at = 0; at < size; at += kStepBytes) {
    cancel.check();
    if (!sync(at + kStepsAhead * kStepBytes, SYNC_FILE_RANGE_WRITE) ||
        !sync(at, SYNC_FILE_RANGE_WAIT_BEFORE | SYNC_FILE_RANGE_WRITE | SYNC_FILE_RANGE_WAIT_AFTER))
      return;  // a file system that cannot
  }
}

void AtomicFile::commit(const CancelFlag* cancel) {
  if (cancel != nullptr) {
    drain(*cancel);
    cancel->check();
  }
  if (fsync(fd_) != 0) failWriting(path_, errno);
  if (std::rename(temporary_path_.c_str(), path_.c_str()) != 0)
    throw ResumableError("cannot give '" + temporary_path_ + "' its name '" + path_ +
                             "': " + std::strerror(errno) + "; check the folder",
                         {.path = temporary_path_});
  // From here the file is published: the destructor has nothing to remove.
  const int fd = fd_;
  fd_ = -1;
  ::close(fd);
  if (const int error = syncFolderOf(path_))
    throw Error("'" + path_ + "' is complete, but its folder could not be made durable: " +
                    std::strerror(error) + "; check the disk",
                {.path = path_});
}

}  // namespace isobrick
