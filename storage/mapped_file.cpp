#include "isobrick/storage/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// A page fault maps the cached pages around it as well, up to this much (the kernel's default), and
// they count as ours until they are given back.
constexpr std::uint64_t kFaultAroundBytes = 64 * 1024;

const std::uint64_t kPageBytes = static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));

}  // namespace

MappedFile::MappedFile(const std::string& path) : path_(path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0)
    throw Error("cannot open '" + path + "': " + std::strerror(errno) + "; check the path",
                {.path = path});
  struct stat status = {};
  if (fstat(fd, &status) != 0 || !S_ISREG(status.st_mode) || status.st_size == 0) {
    ::close(fd);
    throw Error("cannot read '" + path + "': it is empty or not a file; build it again",
                {.path = path});
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
  void* map = mmap(nullptr, size_, PROT_READ, MAP_SHARED, fd, 0);
  const int map_error = errno;
  if (map == MAP_FAILED) {
    ::close(fd);
    throw Error("cannot map '" + path + "': " + std::strerror(map_error) +
                    "; raise the limit on virtual memory",
                {.path = path});
  }
  fd_ = fd;
  data_ = static_cast<const std::byte*>(map);
  if (!guard_.guard(map, size_)) {
    munmap(map, size_);
    ::close(fd);
    throw Error("cannot open '" + path + "': " + std::to_string(kMostFiles) +
                    " pyramids are open already; close some",
                {.path = path});
  }
  // Bricks are asked for as a whole; the kernel's guess around a fault would read others too.
  madvise(map, size_, MADV_RANDOM);
}

MappedFile::~MappedFile() {
  guard_.leave();
  munmap(const_cast<std::byte*>(data_), size_);
  ::close(fd_);
}

bool MappedFile::reaches(std::uint64_t offset, std::uint64_t bytes) const {
  BusErrorGuard::keepInFront();
  struct stat status = {};
  return !failedOffset() && fstat(fd_, &status) == 0 &&
         static_cast<std::uint64_t>(status.st_size) >= offset + bytes;
}

bool MappedFile::checksum(std::uint64_t offset, std::uint64_t bytes, std::uint64_t* result) const {
  BusErrorGuard::keepInFront();
  const std::uint64_t begin = offset / kPageBytes * kPageBytes;
  std::byte* from = const_cast<std::byte*>(data_ + begin);
  madvise(from, offset + bytes - begin, MADV_WILLNEED);
  // One call in place of a fault for every few pages. Kernels before 5.14 do not know it (EINVAL).
  if (madvise(from, offset + bytes - begin, MADV_POPULATE_READ) != 0 && errno != EINVAL)
    return false;
  *result = checksum64(data_ + offset, bytes);
  return !failedOffset();
}

bool MappedFile::read(std::uint64_t offset, std::uint64_t bytes, std::byte* out) const {
  while (bytes > 0) {
    const ssize_t n = ::pread(fd_, out, bytes, static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    out += n;
    offset += static_cast<std::uint64_t>(n);
    bytes -= static_cast<std::uint64_t>(n);
  }
  return true;
}

void MappedFile::release(std::uint64_t offset, std::uint64_t bytes) const {
  const std::uint64_t begin = offset / kFaultAroundBytes * kFaultAroundBytes;
  const std::uint64_t end = std::min(
      size_, (offset + bytes + kFaultAroundBytes - 1) / kFaultAroundBytes * kFaultAroundBytes);
  madvise(const_cast<std::byte*>(data_ + begin), end - begin, MADV_DONTNEED);
}

}  // namespace isobrick
