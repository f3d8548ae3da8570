#include "storage/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <mutex>

#include "storage/checksum.h"
#include "storage/error.h"

namespace isobrick {
namespace {

// A page fault maps the cached pages around it as well, up to this much (the kernel's default), and
// they count as ours until they are given back.
constexpr std::uint64_t kFaultAroundBytes = 64 * 1024;

constexpr std::uint64_t kNothingFailed = ~std::uint64_t{0};

// What the signal handler knows of a mapping. A slot is free while its size is 0; begin is set
// before size, so that the handler never sees half of it.
struct Mapping {
  std::atomic<std::uintptr_t> begin{0};
  std::atomic<std::uint64_t> size{0};
  std::atomic<std::uint64_t> failed_offset{kNothingFailed};
};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

Mapping g_mappings[MappedFile::kMostFiles];
std::mutex g_mappings_mutex;  // for taking and leaving slots; the handler needs none
struct sigaction g_previous_action;
std::uintptr_t g_page_bytes = 4096;

// Only async-signal-safe calls from here on.
void onSigbus(int signal, siginfo_t* info, void*) {
  const auto address = reinterpret_cast<std::uintptr_t>(info->si_addr);
  for (Mapping& mapping : g_mappings) {
    const std::uint64_t size = mapping.size.load();
    const std::uintptr_t begin = mapping.begin.load();
    // A mapping ends with its last page, and another may begin right there.
    const std::uint64_t pages = (size + g_page_bytes - 1) / g_page_bytes;
    if (size == 0 || address < begin || address - begin >= pages * g_page_bytes) continue;
    const std::uintptr_t page = address / g_page_bytes * g_page_bytes;
    const int saved_errno = errno;
    void* const zeros = mmap(reinterpret_cast<void*>(page), g_page_bytes, PROT_READ,
                             MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0);
    errno = saved_errno;
    if (zeros == MAP_FAILED) break;
    std::uint64_t nothing = kNothingFailed;
    mapping.failed_offset.compare_exchange_strong(nothing, page - begin);
    return;
  }
  // Somebody else's: as if this handler did not exist. The instruction faults again.
  sigaction(signal, &g_previous_action, nullptr);
}

void installHandlerOnce() {
  static std::once_flag once;
  std::call_once(once, [] {
    g_page_bytes = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
    struct sigaction action = {};
    action.sa_sigaction = onSigbus;
    action.sa_flags = SA_SIGINFO;
    sigemptyset(&action.sa_mask);
    sigaction(SIGBUS, &action, &g_previous_action);
  });
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
  const std::lock_guard lock(g_mappings_mutex);
  while (slot_ < kMostFiles && g_mappings[slot_].size.load() != 0) ++slot_;
  if (slot_ == kMostFiles) {
    munmap(map, size_);
    ::close(fd);
    throw Error("cannot open '" + path + "': " + std::to_string(kMostFiles) +
                " pyramids are open already; close some");
  }
  g_mappings[slot_].failed_offset.store(kNothingFailed);
  g_mappings[slot_].begin.store(reinterpret_cast<std::uintptr_t>(map));
  g_mappings[slot_].size.store(size_);
  // Bricks are asked for as a whole; the kernel's guess around a fault would read others too.
  madvise(map, size_, MADV_RANDOM);
}

MappedFile::~MappedFile() {
  {
    const std::lock_guard lock(g_mappings_mutex);
    g_mappings[slot_].size.store(0);
  }
  munmap(const_cast<std::byte*>(data_), size_);
  ::close(fd_);
}

std::optional<std::uint64_t> MappedFile::failedOffset() const {
  const std::uint64_t offset = g_mappings[slot_].failed_offset.load();
  if (offset == kNothingFailed) return std::nullopt;
  return offset;
}

bool MappedFile::reaches(std::uint64_t offset, std::uint64_t bytes) const {
  struct stat status = {};
  return !failedOffset() && fstat(fd_, &status) == 0 &&
         static_cast<std::uint64_t>(status.st_size) >= offset + bytes;
}

bool MappedFile::checksum(std::uint64_t offset, std::uint64_t bytes, std::uint64_t* result) const {
  const std::uint64_t begin = offset / g_page_bytes * g_page_bytes;
  std::byte* from = const_cast<std::byte*>(data_ + begin);
  madvise(from, offset + bytes - begin, MADV_WILLNEED);
  // One call in place of a fault for every few pages. Kernels before 5.14 do not know it (EINVAL).
  if (madvise(from, offset + bytes - begin, MADV_POPULATE_READ) != 0 && errno != EINVAL)
    return false;
  *result = checksum64(data_ + offset, bytes);
  return !failedOffset();
}

void MappedFile::release(std::uint64_t offset, std::uint64_t bytes) const {
  const std::uint64_t begin = offset / kFaultAroundBytes * kFaultAroundBytes;
  const std::uint64_t end = std::min(
      size_, (offset + bytes + kFaultAroundBytes - 1) / kFaultAroundBytes * kFaultAroundBytes);
  madvise(const_cast<std::byte*>(data_ + begin), end - begin, MADV_DONTNEED);
}

}  // namespace isobrick
