#include "tests/faults/fault_points.h"

#include <dlfcn.h>
#include <execinfo.h>
#include <fcntl.h>
#include <link.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <limits>
#include <new>

extern "C" {
void* __real_malloc(size_t bytes);
void* __real_aligned_alloc(size_t alignment, size_t bytes);
ssize_t __real_read(int fd, void* out, size_t bytes);
ssize_t __real_pread(int fd, void* out, size_t bytes, off_t offset);
ssize_t __real_preadv(int fd, const iovec* pieces, int count, off_t offset);
int __real_open(const char* path, int flags, mode_t mode);
void* __real_mmap(void* at, size_t bytes, int protection, int flags, int fd, off_t offset);
}

namespace isobrick::test {
namespace {

std::atomic<bool> g_is_armed{false}, g_has_happened{false}, g_strings_too{true}, g_for_good{false};
std::atomic<FaultKind> g_kind{FaultKind::kAllocation};
std::atomic<std::uint64_t> g_number{0};
std::array<std::atomic<std::uint64_t>, std::size(kFaultKinds)> g_counts{};
std::atomic<std::int64_t> g_live{0};

std::atomic<std::int64_t> g_large_left{-1};
std::atomic<std::size_t> g_large_bytes{std::numeric_limits<std::size_t>::max()};
std::atomic<std::size_t> g_least_failing{std::numeric_limits<std::size_t>::max()};

// Where code of a loaded object lies.
struct CodeRange {
  std::uintptr_t begin = 0, end = 0;
  bool holds(const void* address) const {
    const auto at = reinterpret_cast<std::uintptr_t>(address);
    return at >= begin && at < end;
  }
};
CodeRange g_own, g_strings;

int noteObject(dl_phdr_info* info, size_t, void*) {
  const bool is_own = info->dlpi_name == nullptr || *info->dlpi_name == '\0';
  const bool is_strings = !is_own && std::strstr(info->dlpi_name, "libstdc++") != nullptr;
  if ((is_own && g_own.end != 0) || (!is_own && !is_strings)) return 0;
  CodeRange& range = is_own ? g_own : g_strings;
  for (int i = 0; i < info->dlpi_phnum; ++i) {
    const auto& segment = info->dlpi_phdr[i];
    if (segment.p_type != PT_LOAD || (segment.p_flags & PF_X) == 0) continue;
    range = {info->dlpi_addr + segment.p_vaddr,
             info->dlpi_addr + segment.p_vaddr + segment.p_memsz};
  }
  return 0;
}

bool isOwn(const void* caller) {
  return g_own.holds(caller) || (g_strings_too.load() && g_strings.holds(caller));
}

// The destructor of nlohmann's JSON asks for memory, and ends the process if there is none.
bool isInAForeignDestructor() {
  void* frames[40];  // many, if nothing is inlined
  const int count = backtrace(frames, 40);
  for (int i = 0; i < count; ++i) {
    Dl_info info{};
    if (dladdr(frames[i], &info) != 0 && info.dli_sname != nullptr &&
        std::strstr(info.dli_sname, "basic_json") != nullptr &&
        std::strstr(info.dli_sname, "destroy") != nullptr)
      return true;
  }
  return false;
}

bool failsNow(FaultKind kind) {
  if (!g_is_armed.load(std::memory_order_relaxed)) return false;
  const std::uint64_t number = ++g_counts[static_cast<std::size_t>(kind)];
  const std::uint64_t first = g_number.load();
  if (g_kind.load() != kind || first == 0 || number < first) return false;
  if (number > first && !g_for_good.load()) return false;
  if (kind == FaultKind::kAllocation && isInAForeignDestructor()) return false;
  g_has_happened = true;
  return true;
}

bool failsToAllocate(std::size_t bytes, const void* caller) {
  if (bytes >= g_large_bytes.load(std::memory_order_relaxed) && isOwn(caller)) {
    if (g_large_left.fetch_sub(1) == 1) g_least_failing = bytes;
    if (bytes >= g_least_failing.load()) return true;
  }
  return g_is_armed.load(std::memory_order_relaxed) && isOwn(caller) &&
         failsNow(FaultKind::kAllocation);
}

void* allocate(std::size_t bytes, std::size_t alignment, const void* caller) {
  if (failsToAllocate(bytes, caller)) throw std::bad_alloc();
  void* const memory =
      alignment == 0
          ? __real_malloc(std::max<std::size_t>(bytes, 1))
          : __real_aligned_alloc(alignment, (std::max<std::size_t>(bytes, 1) + alignment - 1) /
                                                alignment * alignment);
  if (memory == nullptr) throw std::bad_alloc();
  g_live.fetch_add(1, std::memory_order_relaxed);
  return memory;
}

void* allocateOrNothing(std::size_t bytes, const void* caller) noexcept try {
  return allocate(bytes, 0, caller);
} catch (const std::bad_alloc&) {
  return nullptr;
}

void giveBack(void* memory) {
  if (memory == nullptr) return;
  g_live.fetch_sub(1, std::memory_order_relaxed);
  std::free(memory);
}

}  // namespace

const char* nameOf(FaultKind kind) {
  constexpr const char* kNames[] = {"alloc", "read", "open", "map", "thread", "write", "socket"};
  return kNames[static_cast<std::size_t>(kind)];
}

bool failsWith(FaultKind kind, int error) {
  if (!failsNow(kind)) return false;
  errno = error;
  return true;
}

void armFault(FaultKind kind, std::uint64_t n, FaultScope scope) {
  if (g_own.end == 0) {
    dl_iterate_phdr(noteObject, nullptr);
    isInAForeignDestructor();  // what backtrace() loads, it loads here
  }
  for (auto& count : g_counts) count = 0;
  g_has_happened = false;
  g_strings_too = scope.strings_too;
  g_for_good = scope.for_good;
  g_kind = kind;
  g_number = n;
  g_is_armed = true;
}
void disarmFaults() { g_is_armed = false; }
std::uint64_t countedCalls(FaultKind kind) { return g_counts[static_cast<std::size_t>(kind)]; }
bool hasFaultHappened() { return g_has_happened; }

void armLargeAllocations(std::uint64_t n, std::size_t bytes) {
  if (g_own.end == 0) dl_iterate_phdr(noteObject, nullptr);
  g_strings_too = false;
  g_large_left = static_cast<std::int64_t>(n);
  g_large_bytes = bytes;
}

std::int64_t liveAllocations() { return g_live; }

}  // namespace isobrick::test

using isobrick::test::FaultKind;

// NOLINTBEGIN: the names are those that --wrap gives
extern "C" {

void* __wrap_malloc(size_t bytes) {
  return isobrick::test::failsToAllocate(bytes, __builtin_return_address(0)) ? nullptr
                                                                             : __real_malloc(bytes);
}
void* __wrap_aligned_alloc(size_t alignment, size_t bytes) {
  return isobrick::test::failsToAllocate(bytes, __builtin_return_address(0))
             ? nullptr
             : __real_aligned_alloc(alignment, bytes);
}

ssize_t __wrap_read(int fd, void* out, size_t bytes) {
  return isobrick::test::failsWith(FaultKind::kRead, EIO) ? -1 : __real_read(fd, out, bytes);
}
ssize_t __wrap_pread(int fd, void* out, size_t bytes, off_t offset) {
  return isobrick::test::failsWith(FaultKind::kRead, EIO) ? -1
                                                          : __real_pread(fd, out, bytes, offset);
}
ssize_t __wrap_preadv(int fd, const iovec* pieces, int count, off_t offset) {
  return isobrick::test::failsWith(FaultKind::kRead, EIO)
             ? -1
             : __real_preadv(fd, pieces, count, offset);
}

int __wrap_open(const char* path, int flags, ...) {
  mode_t mode = 0;
  if ((flags & (O_CREAT | O_TMPFILE)) != 0) {
    va_list arguments;
    va_start(arguments, flags);
    mode = va_arg(arguments, mode_t);
    va_end(arguments);
  }
  return isobrick::test::failsWith(FaultKind::kOpen, EMFILE) ? -1 : __real_open(path, flags, mode);
}

void* __wrap_mmap(void* at, size_t bytes, int protection, int flags, int fd, off_t offset) {
  return isobrick::test::failsWith(FaultKind::kMap, ENOMEM)
             ? MAP_FAILED
             : __real_mmap(at, bytes, protection, flags, fd, offset);
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*work)(void*),
                   void* argument) {
  using Create = int (*)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*);
  static const auto real = reinterpret_cast<Create>(dlsym(RTLD_NEXT, "pthread_create"));
  if ((isobrick::test::g_own.holds(__builtin_return_address(0)) ||
       isobrick::test::g_strings.holds(__builtin_return_address(0))) &&
      isobrick::test::failsNow(FaultKind::kThread))
    return EAGAIN;
  return real(thread, attributes, work, argument);
}

}  // extern "C"

void* operator new(std::size_t bytes) {
  return isobrick::test::allocate(bytes, 0, __builtin_return_address(0));
}
void* operator new[](std::size_t bytes) {
  return isobrick::test::allocate(bytes, 0, __builtin_return_address(0));
}
void* operator new(std::size_t bytes, std::align_val_t alignment) {
  return isobrick::test::allocate(bytes, static_cast<std::size_t>(alignment),
                                  __builtin_return_address(0));
}
void* operator new[](std::size_t bytes, std::align_val_t alignment) {
  return isobrick::test::allocate(bytes, static_cast<std::size_t>(alignment),
                                  __builtin_return_address(0));
}
// std::stable_sort takes its buffer so.
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
  return isobrick::test::allocateOrNothing(bytes, __builtin_return_address(0));
}
void* operator new[](std::size_t bytes, const std::nothrow_t&) noexcept {
  return isobrick::test::allocateOrNothing(bytes, __builtin_return_address(0));
}
void operator delete(void* memory) noexcept { isobrick::test::giveBack(memory); }
void operator delete[](void* memory) noexcept { isobrick::test::giveBack(memory); }
void operator delete(void* memory, std::size_t) noexcept { isobrick::test::giveBack(memory); }
void operator delete[](void* memory, std::size_t) noexcept { isobrick::test::giveBack(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { isobrick::test::giveBack(memory); }
void operator delete[](void* memory, std::align_val_t) noexcept {
  isobrick::test::giveBack(memory);
}
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept {
  isobrick::test::giveBack(memory);
}
void operator delete[](void* memory, std::size_t, std::align_val_t) noexcept {
  isobrick::test::giveBack(memory);
}
// NOLINTEND
