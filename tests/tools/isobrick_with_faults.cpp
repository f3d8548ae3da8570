// The `isobrick` command in a world where things go wrong at an exact moment:
//
//   isobrick_with_faults FAULT build ...        (and convert)
//   isobrick_extract_with_faults FAULT extract ...  (and info, verify, render, merge, cache, serve)
//   isobrick_view_with_faults FAULT view ...
//
//   signal:S:N   signal S arrives just before the N-th change to the file system
//   disk:B       the disk has room for B bytes more, and says so
//   quota:B      the same, but it says nothing of it beforehand
//   memory:N     the N-th allocation of 4 KiB or more fails, and all that are larger
//   KIND:N       the N-th call of a kind fails, once: alloc, read, open, map, thread, write or
//   socket
//                (tests/faults/fault_points.h); KIND:N+: and all after it
//   count:PATH   nothing fails; at the end how many calls there were is in that file, a line a kind
//   record:PATH  nothing fails; at the end all changes of the current folder are in that file
//                (tests/faults/change_record.h)
//   none
//
// It is linked from the command's own objects; the calls to the system that are named in
// tests/CMakeLists.txt lead here first (the linker's --wrap). What a killed process leaves can only
// be different after another such call, so one kill before each of them is all moments there are.
// The command's status and output are its own.

#include <fcntl.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/statvfs.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "tests/faults/change_record.h"
#include "tests/faults/fault_points.h"

namespace {

using isobrick::test::failsWith;
using isobrick::test::FaultKind;

constexpr std::size_t kLargeAllocation = 4096;

int g_signal = 0;
std::atomic<std::int64_t> g_changes_before_signal{-1};
bool g_disk_is_limited = false, g_disk_tells = false;
std::atomic<std::int64_t> g_disk_bytes{0};  // left, where it is limited
std::string g_counts_path, g_record_path;

// Drivers and toolkits that are loaded use the C++ library too, and do not survive.
void armOwnFault(FaultKind kind, std::uint64_t n, bool for_good) {
  isobrick::test::armFault(kind, n, {.strings_too = false, .for_good = for_good});
}

// False for a text that is none of the above.
bool readFault(const char* text) {
  int signal = 0;
  long long number = 0;
  char rest = 0;
  if (std::sscanf(text, "signal:%d:%lld%c", &signal, &number, &rest) == 2) {
    g_signal = signal;
    g_changes_before_signal = number;
    return true;
  }
  if (std::sscanf(text, "disk:%lld%c", &number, &rest) == 1) {
    g_disk_bytes = number;
    g_disk_is_limited = g_disk_tells = true;
    return true;
  }
  if (std::sscanf(text, "quota:%lld%c", &number, &rest) == 1) {
    g_disk_bytes = number;
    g_disk_is_limited = true;
    return true;
  }
  if (std::sscanf(text, "memory:%lld%c", &number, &rest) == 1) {
    isobrick::test::armLargeAllocations(static_cast<std::uint64_t>(number), kLargeAllocation);
    return true;
  }
  for (const auto kind : isobrick::test::kFaultKinds) {
    const std::string format = std::string(isobrick::test::nameOf(kind)) + ":%lld%c";
    const int taken = std::sscanf(text, format.c_str(), &number, &rest);
    if (taken != 1 && !(taken == 2 && rest == '+')) continue;
    armOwnFault(kind, static_cast<std::uint64_t>(number), taken == 2);
    return true;
  }
  if (std::strncmp(text, "count:", 6) == 0) {
    g_counts_path = text + 6;
    armOwnFault(FaultKind::kAllocation, 0, false);
    return true;
  }
  if (std::strncmp(text, "record:", 7) == 0) {
    g_record_path = text + 7;
    isobrick::test::beginChanges();
    return true;
  }
  return std::strcmp(text, "none") == 0;
}

void raiseIfDue() {
  if (g_changes_before_signal.fetch_sub(1) == 1) std::raise(g_signal);
}
// True if the change is to fail.
bool beforeChange() {
  raiseIfDue();
  return failsWith(FaultKind::kWrite, EIO);
}

// How many of `bytes` still fit, which are taken; none: errno is set.
std::size_t takeSpace(std::size_t bytes) {
  if (!g_disk_is_limited) return bytes;
  std::int64_t left = g_disk_bytes.load(), taken = 0;
  do {
    taken = std::min(left, static_cast<std::int64_t>(bytes));
  } while (!g_disk_bytes.compare_exchange_weak(left, left - taken));
  if (taken == 0 && bytes > 0) errno = ENOSPC;
  return static_cast<std::size_t>(taken);
}

void writeNotes() {
  isobrick::test::disarmFaults();
  if (!g_record_path.empty()) isobrick::test::writeChanges(g_record_path);
  if (g_counts_path.empty()) return;
  std::FILE* const file = std::fopen(g_counts_path.c_str(), "w");
  for (const auto kind : isobrick::test::kFaultKinds)
    std::fprintf(file, "%s %llu\n", isobrick::test::nameOf(kind),
                 static_cast<unsigned long long>(isobrick::test::countedCalls(kind)));
  std::fclose(file);
}

}  // namespace

extern "C" {

int __real_main(int argc, char** argv);
int __wrap_main(int argc, char** argv) {
  if (argc < 2 || !readFault(argv[1])) return 125;
  argv[1] = argv[0];
  const int status = __real_main(argc - 1, argv + 1);
  writeNotes();
  return status;
}

ssize_t __real_write(int fd, const void* data, size_t bytes);
ssize_t __wrap_write(int fd, const void* data, size_t bytes) {
  if (beforeChange()) return -1;
  const std::size_t taken = takeSpace(bytes);
  return taken == 0 && bytes > 0 ? -1 : __real_write(fd, data, taken);
}

ssize_t __real_pwrite(int fd, const void* data, size_t bytes, off_t offset);
ssize_t __wrap_pwrite(int fd, const void* data, size_t bytes, off_t offset) {
  if (beforeChange()) return -1;
  const std::size_t taken = takeSpace(bytes);
  return taken == 0 && bytes > 0 ? -1 : __real_pwrite(fd, data, taken, offset);
}

ssize_t __real_pwritev(int fd, const iovec* pieces, int count, off_t offset);
ssize_t __wrap_pwritev(int fd, const iovec* pieces, int count, off_t offset) {
  if (!g_disk_is_limited) {
    if (beforeChange()) return -1;
    return __real_pwritev(fd, pieces, count, offset);
  }
  // One piece at a time, so that the last one that fits can be cut.
  while (count > 1 && pieces->iov_len == 0) ++pieces, --count;
  return __wrap_pwrite(fd, pieces->iov_base, pieces->iov_len, offset);
}

int __real_ftruncate(int fd, off_t bytes);
int __wrap_ftruncate(int fd, off_t bytes) {
  return beforeChange() ? -1 : __real_ftruncate(fd, bytes);
}

int __real_fallocate(int fd, int mode, off_t offset, off_t bytes);
int __wrap_fallocate(int fd, int mode, off_t offset, off_t bytes) {
  if (beforeChange()) return -1;
  if (!g_disk_tells || bytes <= g_disk_bytes.load())
    return __real_fallocate(fd, mode, offset, bytes);
  errno = ENOSPC;
  return -1;
}

int __real_rename(const char* from, const char* to);
int __wrap_rename(const char* from, const char* to) {
  return beforeChange() ? -1 : __real_rename(from, to);
}

int __real_unlink(const char* path);
int __wrap_unlink(const char* path) {  // never fails: what is to go would stay
  raiseIfDue();
  return __real_unlink(path);
}

int __real_fstatvfs(int fd, struct statvfs* status);
int __wrap_fstatvfs(int fd, struct statvfs* status) {
  const int result = __real_fstatvfs(fd, status);
  if (result == 0 && g_disk_tells)
    status->f_bavail = static_cast<fsblkcnt_t>(g_disk_bytes.load()) / status->f_frsize;
  return result;
}

int __real_renameat2(int a, const char* from, int b, const char* to, unsigned flags);
int __wrap_renameat2(int a, const char* from, int b, const char* to, unsigned flags) {
  return failsWith(FaultKind::kWrite, EIO) ? -1 : __real_renameat2(a, from, b, to, flags);
}
int __real_fsync(int fd);
int __wrap_fsync(int fd) { return failsWith(FaultKind::kWrite, EIO) ? -1 : __real_fsync(fd); }
int __real_syncfs(int fd);
int __wrap_syncfs(int fd) { return failsWith(FaultKind::kWrite, EIO) ? -1 : __real_syncfs(fd); }

int __real_socket(int domain, int type, int protocol);
int __wrap_socket(int domain, int type, int protocol) {
  return failsWith(FaultKind::kSocket, EMFILE) ? -1 : __real_socket(domain, type, protocol);
}
int __real_epoll_create1(int flags);
int __wrap_epoll_create1(int flags) {
  return failsWith(FaultKind::kSocket, EMFILE) ? -1 : __real_epoll_create1(flags);
}
int __real_bind(int fd, const sockaddr* address, socklen_t bytes);
int __wrap_bind(int fd, const sockaddr* address, socklen_t bytes) {
  return failsWith(FaultKind::kSocket, EADDRINUSE) ? -1 : __real_bind(fd, address, bytes);
}
int __real_listen(int fd, int waiting);
int __wrap_listen(int fd, int waiting) {
  return failsWith(FaultKind::kSocket, EADDRINUSE) ? -1 : __real_listen(fd, waiting);
}
int __real_accept(int fd, sockaddr* address, socklen_t* bytes);
int __wrap_accept(int fd, sockaddr* address, socklen_t* bytes) {
  return failsWith(FaultKind::kSocket, EMFILE) ? -1 : __real_accept(fd, address, bytes);
}
ssize_t __real_recv(int fd, void* out, size_t bytes, int flags);
ssize_t __wrap_recv(int fd, void* out, size_t bytes, int flags) {
  return failsWith(FaultKind::kSocket, ECONNRESET) ? -1 : __real_recv(fd, out, bytes, flags);
}
ssize_t __real_recvmsg(int fd, msghdr* message, int flags);
ssize_t __wrap_recvmsg(int fd, msghdr* message, int flags) {
  return failsWith(FaultKind::kSocket, ECONNRESET) ? -1 : __real_recvmsg(fd, message, flags);
}
ssize_t __real_send(int fd, const void* data, size_t bytes, int flags);
ssize_t __wrap_send(int fd, const void* data, size_t bytes, int flags) {
  return failsWith(FaultKind::kSocket, ECONNRESET) ? -1 : __real_send(fd, data, bytes, flags);
}
ssize_t __real_sendmsg(int fd, const msghdr* message, int flags);
ssize_t __wrap_sendmsg(int fd, const msghdr* message, int flags) {
  return failsWith(FaultKind::kSocket, ECONNRESET) ? -1 : __real_sendmsg(fd, message, flags);
}

}  // extern "C"
