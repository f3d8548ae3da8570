#include "tests/extract/read_faults.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <stdexcept>

namespace isobrick::test {
namespace {

// Reads of this file in this range fail; empty: none.
std::atomic<std::uint64_t> g_begin{0}, g_end{0};
std::atomic<ino_t> g_file{0};
std::atomic<ReadFault> g_fault{ReadFault::kIoError};
std::atomic<unsigned> g_count{0};

bool isFaulty(int fd, std::uint64_t at, std::size_t bytes) {
  struct stat status = {};
  return at < g_end && at + bytes > g_begin && fstat(fd, &status) == 0 && status.st_ino == g_file;
}

}  // namespace

FaultyReads::FaultyReads(const std::string& path, ReadFault fault, std::uint64_t begin,
                         std::uint64_t end) {
  struct stat status = {};
  if (stat(path.c_str(), &status) != 0) throw std::runtime_error("no file " + path);
  g_file = status.st_ino;
  g_fault = fault;
  g_count = 0;
  g_begin = begin;
  g_end = end;
}
FaultyReads::~FaultyReads() { g_end = 0; }

unsigned FaultyReads::count() { return g_count; }

}  // namespace isobrick::test

// The linker leads pread() of this executable here first (tests/CMakeLists.txt).
extern "C" {
ssize_t __real_pread(int fd, void* out, size_t bytes, off_t offset);
ssize_t __wrap_pread(int fd, void* out, size_t bytes, off_t offset) {
  using namespace isobrick::test;
  if (!isFaulty(fd, static_cast<std::uint64_t>(offset), bytes))
    return __real_pread(fd, out, bytes, offset);
  const unsigned count = g_count++;
  switch (g_fault) {
    case ReadFault::kIoError:
      errno = EIO;
      return -1;
    case ReadFault::kEndOfFile:
      return 0;
    case ReadFault::kFewBytes:
      return __real_pread(fd, out, std::min<size_t>(bytes, 1 + count * 37 % 1000), offset);
    case ReadFault::kInterrupted:
      break;
  }
  if (count % 3 == 2) return __real_pread(fd, out, bytes, offset);
  errno = EINTR;
  return -1;
}
}
