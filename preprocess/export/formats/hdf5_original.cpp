#include "isobrick/preprocess/export/formats/hdf5_original.h"

#include <fcntl.h>
#include <linux/fs.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <vector>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {
namespace {

Error failed(const std::string& path, int error) {
  return unreadable(path, std::string(std::strerror(error)) + "; check the file");
}

}  // namespace

std::optional<Hdf5Original> Hdf5Original::open(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0 && errno == ENOENT) return std::nullopt;
  if (fd < 0) throw failed(path, errno);
  return Hdf5Original(path, fd);
}

Hdf5Original::Hdf5Original(const std::string& path, int fd) : path_(path), file_(fd) {
  const bool is_busy = flock(fd, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  const int error = fstat(fd, &status_) != 0 ? errno : S_ISREG(status_.st_mode) ? 0 : EINVAL;
  if (error != 0) throw failed(path_, error);
  if (is_busy) throw unwritable(path_, "another program has it open for writing; close it there");
}

void Hdf5Original::refuseTooLittleSpace(const AtomicFile& copy) const {
  const std::optional<std::uint64_t> have = copy.freeBytes();
  if (!have || *have >= bytes()) return;
  const auto mebibytes = [](std::uint64_t n) { return std::to_string((n >> 20) + 1) + " MiB"; };
  throw ResumableError(
      "not enough space to add to '" + path_ + "': a copy beside it, with the new " +
          "dataset, takes its place in the end; the copy takes " + mebibytes(bytes()) +
          " and the disk has " + mebibytes(*have) + "; free some space or choose another file",
      {.path = path_});
}

void Hdf5Original::copyTo(AtomicFile& copy, const CancelFlag* cancel,
                          const std::function<void(std::uint64_t)>& progress) const {
  // Comes first, so that no other user reads bytes that only the owner may read.
  if (fchown(copy.fd(), status_.st_uid, status_.st_gid) != 0 && errno != EPERM)
    throw failed(path_, errno);
  if (fchmod(copy.fd(), status_.st_mode & 07777) != 0) throw failed(path_, errno);
  if (ioctl(copy.fd(), FICLONE, file_.get()) == 0) return;
  refuseTooLittleSpace(copy);
  constexpr std::uint64_t kStepBytes = std::uint64_t{4} << 20;
  std::vector<std::byte> buffer(static_cast<std::size_t>(std::min(bytes(), kStepBytes)));
  for (std::uint64_t at = 0; at < bytes(); at += buffer.size()) {
    if (cancel != nullptr) cancel->check();
    const auto step =
        static_cast<std::size_t>(std::min<std::uint64_t>(bytes() - at, buffer.size()));
    const IoResult read = readBytesAt(file_.get(), at, buffer.data(), step);
    if (read.bytes != step) throw failed(path_, read.error != 0 ? read.error : EIO);
    copy.pwrite(buffer.data(), step, at);
    progress(at + step);
  }
}

void Hdf5Original::refuseChanged() const {
  struct stat now = {}, named = {};
  const auto isSame = [](const struct stat& a, const struct stat& b) {
    return a.st_dev == b.st_dev && a.st_ino == b.st_ino && a.st_size == b.st_size &&
           a.st_mtim.tv_sec == b.st_mtim.tv_sec && a.st_mtim.tv_nsec == b.st_mtim.tv_nsec;
  };
  if (fstat(file_.get(), &now) == 0 && stat(path_.c_str(), &named) == 0 && isSame(now, status_) &&
      isSame(named, status_))
    return;
  throw Error("'" + path_ + "' changed while a dataset was added, and stays as it is; try again " +
                  "when nobody writes it",
              {.path = path_});
}

}  // namespace isobrick
