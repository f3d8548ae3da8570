#include "storage/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csetjmp>
#include <csignal>
#include <cstring>
#include <mutex>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "storage/error.h"

namespace isobrick {
namespace {

// Where this thread goes when a page of the piece that it reads cannot be had.
thread_local sigjmp_buf* t_escape = nullptr;
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
  ::close(fd);
  if (map == MAP_FAILED)
    throw Error("cannot map '" + path + "': " + std::strerror(map_error) +
                "; raise the limit on virtual memory");
  data_ = static_cast<const std::byte*>(map);
  // Bricks are asked for as a whole; the kernel's guess around a fault would read others too.
  madvise(map, size_, MADV_RANDOM);
}

MappedFile::~MappedFile() { munmap(const_cast<std::byte*>(data_), size_); }

bool MappedFile::checksum(std::uint64_t offset, std::uint64_t bytes, std::uint64_t* result) const {
  const std::uint64_t begin = offset / pageBytes() * pageBytes();
  madvise(const_cast<std::byte*>(data_ + begin), offset + bytes - begin, MADV_WILLNEED);
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
  const std::uint64_t page = pageBytes();
  const std::uint64_t begin = (offset + page - 1) / page * page;
  const std::uint64_t end = (offset + bytes) / page * page;
  if (begin < end) madvise(const_cast<std::byte*>(data_ + begin), end - begin, MADV_DONTNEED);
}

}  // namespace isobrick
