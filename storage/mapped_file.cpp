#include "storage/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csetjmp>
#include <csignal>
#include <cstring>
#include <mutex>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "storage/error.h"

namespace isobrick {
namespace {

// A page fault maps the cached pages around it as well, up to this much (the kernel's default), and
// they count as ours until they are given back.
constexpr std::uint64_t kFaultAroundBytes = 64 * 1024;

// Where this thread goes when a page of the piece that it reads cannot be had. Volatile: only the
// signal handler looks at it, so the compiler would drop the first of two stores.
thread_local sigjmp_buf* volatile t_escape = nullptr;
struct sigaction g_previous_action;

void onSigbus(int signal, siginfo_t* info, void* context) {
  if (t_escape != nullptr) siglongjmp(*t_escape, 1);
  // Not one of our guarded reads. Another handler may know it; else say why the process ends.
  if ((g_previous_action.sa_flags & SA_SIGINFO) != 0 && g_previous_action.sa_sigaction != nullptr) {
    g_previous_action.sa_sigaction(signal, info, context);
    return;
  }
  if (g_previous_action.sa_handler != SIG_DFL && g_previous_action.sa_handler != SIG_IGN) {
    g_previous_action.sa_handler(signal);
    return;
  }
  static constexpr char kMessage[] =
      "isobrick: a mapped file became unreadable while in use (cut short, or its disk failed); "
      "check the disk and the file, then run again\n";
  [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, kMessage, sizeof kMessage - 1);
  _exit(1);
}

void installHandlerOnce() {
  static std::once_flag once;
  std::call_once(once, [] {
    struct sigaction action = {};
    action.sa_sigaction = onSigbus;
    action.sa_flags = SA_SIGINFO | SA_NODEFER;
    sigemptyset(&action.sa_mask);
    sigaction(SIGBUS, &action, &g_previous_action);
  });
}

std::uint64_t pageBytes() {
  static const std::uint64_t bytes = static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  return bytes;
}

}  // namespace

MappedFile::MappedFile(const std::string& path) : path_(path) {
  installHandlerOnce();
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0)
    throw Error("cannot open '" + path + "': " + std::strerror(errno) + "; check the path");
  struct stat status = {};
  if (fstat(fd, &status) != 0 || !S_ISREG(status.st_mode) || status.st_size == 0) {
    ::close(fd);
    throw Error("cannot read '" + path + "': it is empty or not a file; build it again");
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
  void* map = mmap(nullptr, size_, PROT_READ, MAP_SHARED, fd, 0);
  const int map_error = errno;
  if (map == MAP_FAILED) {
    ::close(fd);
    throw Error("cannot map '" + path + "': " + std::strerror(map_error) +
                "; raise the limit on virtual memory");
  }
  fd_ = fd;
  data_ = static_cast<const std::byte*>(map);
  // Bricks are asked for as a whole; the kernel's guess around a fault would read others too.
  madvise(map, size_, MADV_RANDOM);
}

MappedFile::~MappedFile() {
  munmap(const_cast<std::byte*>(data_), size_);
  ::close(fd_);
}

bool MappedFile::reaches(std::uint64_t offset, std::uint64_t bytes) const {
  struct stat status = {};
  return fstat(fd_, &status) == 0 && static_cast<std::uint64_t>(status.st_size) >= offset + bytes;
}

bool MappedFile::checksum(std::uint64_t offset, std::uint64_t bytes, std::uint64_t* result) const {
  const std::uint64_t begin = offset / pageBytes() * pageBytes();
  std::byte* from = const_cast<std::byte*>(data_ + begin);
  madvise(from, offset + bytes - begin, MADV_WILLNEED);
  // One call in place of a fault for every few pages. Kernels before 5.14 do not know it (EINVAL).
  if (madvise(from, offset + bytes - begin, MADV_POPULATE_READ) != 0 && errno != EINVAL)
    return false;
  sigjmp_buf escape;
  if (sigsetjmp(escape, 0) != 0) {
    t_escape = nullptr;
    return false;
  }
  t_escape = &escape;
  const std::uint64_t sum = XXH3_64bits(data_ + offset, bytes);
  t_escape = nullptr;
  *result = sum;
  return true;
}

void MappedFile::release(std::uint64_t offset, std::uint64_t bytes) const {
  const std::uint64_t begin = offset / kFaultAroundBytes * kFaultAroundBytes;
  const std::uint64_t end = std::min(
      size_, (offset + bytes + kFaultAroundBytes - 1) / kFaultAroundBytes * kFaultAroundBytes);
  madvise(const_cast<std::byte*>(data_ + begin), end - begin, MADV_DONTNEED);
}

}  // namespace isobrick
