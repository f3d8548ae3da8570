#include "tests/support/open_faults.h"

#include <sys/stat.h>

#include <cerrno>
#include <cstdarg>
#include <mutex>

namespace isobrick::test {
namespace {

std::mutex g_mutex;  // guards both
std::string g_path;
int g_error = 0;

// 0: none.
int failureOf(const char* path) {
  const std::lock_guard lock(g_mutex);
  return g_error != 0 && g_path == path ? g_error : 0;
}

}  // namespace

FaultyOpen::FaultyOpen(const std::string& path, int error) {
  const std::lock_guard lock(g_mutex);
  g_path = path;
  g_error = error;
}
FaultyOpen::~FaultyOpen() {
  const std::lock_guard lock(g_mutex);
  g_error = 0;
}

}  // namespace isobrick::test

// The linker leads these calls of this executable here first (tests/CMakeLists.txt).
extern "C" {
int __real_open(const char* path, int flags, ...);
int __wrap_open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const unsigned mode = va_arg(rest, unsigned);  // read by the system for new files alone
  va_end(rest);
  const int error = isobrick::test::failureOf(path);
  if (error == 0) return __real_open(path, flags, mode);
  errno = error;
  return -1;
}

int __real_stat(const char* path, struct stat* out);
int __wrap_stat(const char* path, struct stat* out) {
  const int error = isobrick::test::failureOf(path);
  if (error == 0) return __real_stat(path, out);
  errno = error;
  return -1;
}
}
