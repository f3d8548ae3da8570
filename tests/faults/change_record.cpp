#include "tests/faults/change_record.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include "tests/support/file_bytes.h"

namespace isobrick::test {
namespace {

namespace fs = std::filesystem;

using Node = std::pair<dev_t, ino_t>;

std::atomic<bool> g_notes{false};
std::mutex g_mutex;  // also held during a call, so that the order is that of the calls
std::string g_folder;
std::vector<Change> g_changes;
std::set<Node> g_nodes;  // of the folder

// The function of the C library that one of this file stands in front of.
template <typename Function>
Function* realOf(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

// Calls, and notes what it did if it did something.
template <typename Call, typename Note>
auto noting(Call&& call, Note&& note) -> decltype(call()) {
  if (!g_notes) return call();
  const std::lock_guard lock(g_mutex);
  const auto result = call();
  if (result >= 0) {
    const int error = errno;
    note(result);
    errno = error;
  }
  return result;
}

std::string wholePath(int folder, const char* path) {
  if (*path == '/') return path;
  if (folder == AT_FDCWD) return g_folder + "/" + path;
  char name[4096] = {};
  const std::string link = "/proc/self/fd/" + std::to_string(folder);
  return readlink(link.c_str(), name, sizeof name - 1) > 0 ? std::string(name) + "/" + path : path;
}

// Nothing outside of the folder.
std::optional<std::string> nameIn(int folder, const char* path) {
  const std::string whole = fs::path(wholePath(folder, path)).lexically_normal().string();
  if (whole == g_folder) return "";
  if (whole.rfind(g_folder + "/", 0) != 0) return std::nullopt;
  return whole.substr(g_folder.size() + 1);
}

Node nodeOf(const struct stat& status) { return {status.st_dev, status.st_ino}; }

void add(ChangeKind kind, std::uint64_t node, std::uint64_t offset, std::string path = "",
         std::string other = "") {
  g_changes.push_back({kind, node, offset, std::move(path), std::move(other)});
}

// Of a file of the folder; nothing of others.
std::optional<struct stat> knownFile(int fd) {
  struct stat status = {};
  if (fstat(fd, &status) != 0 || g_nodes.count(nodeOf(status)) == 0) return std::nullopt;
  return status;
}

void noteWrite(int fd, std::uint64_t offset, const void* data, std::size_t bytes) {
  if (const auto status = knownFile(fd); status && bytes > 0)
    add(ChangeKind::kWrite, status->st_ino, offset, "",
        std::string(static_cast<const char*>(data), bytes));
}
std::string gathered(const iovec* pieces, int count, std::size_t bytes) {
  std::string all;
  for (int i = 0; i < count; ++i)
    all.append(static_cast<const char*>(pieces[i].iov_base), pieces[i].iov_len);
  all.resize(bytes);
  return all;
}
// Where the bytes went that were just written at the position.
std::uint64_t positionBefore(int fd, ssize_t bytes) {
  return static_cast<std::uint64_t>(lseek(fd, 0, SEEK_CUR) - bytes);
}
void noteSize(int fd) {
  if (const auto status = knownFile(fd))
    add(ChangeKind::kTruncate, status->st_ino, static_cast<std::uint64_t>(status->st_size));
}
void noteSync(int fd) {
  if (const auto status = knownFile(fd)) add(ChangeKind::kSync, status->st_ino, 0);
}

// A new file or folder, or one that was not there; inodes are used again.
void noteNew(ChangeKind kind, const std::optional<std::string>& name, const struct stat& status) {
  g_nodes.erase(nodeOf(status));
  if (!name) return;
  g_nodes.insert(nodeOf(status));
  add(kind, status.st_ino, 0, *name);
}

template <typename Call>
int noteOpen(int folder, const char* path, int flags, Call&& call) {
  if (!g_notes || (flags & (O_CREAT | O_TRUNC | O_TMPFILE)) == 0) return call();
  struct stat before = {};
  const bool was_there = lstat(wholePath(folder, path).c_str(), &before) == 0;
  return noting(call, [&](int fd) {
    struct stat status = {};
    if (fstat(fd, &status) != 0) return;
    if ((flags & O_TMPFILE) == O_TMPFILE) return noteNew(ChangeKind::kFile, std::nullopt, status);
    if (!was_there) return noteNew(ChangeKind::kFile, nameIn(folder, path), status);
    if ((flags & O_TRUNC) != 0) noteSize(fd);
  });
}

int noteRemoval(int folder, const char* path, const std::function<int()>& call) {
  return noting(call, [&](int) {
    if (const auto name = nameIn(folder, path)) add(ChangeKind::kRemove, 0, 0, *name);
  });
}

int noteTwoNames(ChangeKind kind, const char* from, const char* to,
                 const std::function<int()>& call) {
  return noting(call, [&](int) {
    const auto a = nameIn(AT_FDCWD, from), b = nameIn(AT_FDCWD, to);
    if (a && b) add(kind, 0, 0, *a, *b);
  });
}

}  // namespace

void beginChanges() {
  g_folder = fs::current_path().string();
  const auto take = [](const fs::path& path, const std::string& name) {
    struct stat status = {};
    if (lstat(path.c_str(), &status) != 0) return;
    const bool is_file = S_ISREG(status.st_mode);
    noteNew(is_file ? ChangeKind::kFile : ChangeKind::kFolder, name, status);
    if (is_file) add(ChangeKind::kWrite, status.st_ino, 0, "", readBytes(path));
  };
  take(g_folder, "");
  for (const auto& entry : fs::recursive_directory_iterator(g_folder))
    take(entry.path(), *nameIn(AT_FDCWD, entry.path().c_str()));
  add(ChangeKind::kSyncAll, 0, 0);
  g_notes = true;
}

void writeChanges(const std::string& file) {
  g_notes = false;
  std::string text;
  for (const Change& change : g_changes) {
    const std::uint64_t numbers[] = {static_cast<std::uint64_t>(change.kind), change.node,
                                     change.offset, change.path.size(), change.other.size()};
    text.append(reinterpret_cast<const char*>(numbers), sizeof numbers);
    text += change.path + change.other;
  }
  writeBytes(file, text);
}

}  // namespace isobrick::test

namespace test = isobrick::test;
using test::ChangeKind;

// Names of the C library, which libraries that are loaded call too: so the wrapped calls of
// isobrick_with_faults.cpp lead here as well. NOLINTBEGIN
extern "C" {

#define ISOBRICK_RECORDED(result, name, ...)      \
  result recorded_##name(__VA_ARGS__) asm(#name); \
  result recorded_##name(__VA_ARGS__)
// The same function by its name for large files, which is one on 64-bit machines.
#define ISOBRICK_SAME(result, name, ...) \
  result recorded_##name##64(__VA_ARGS__) asm(#name "64") __attribute__((alias(#name)))

ISOBRICK_RECORDED(int, open, const char* path, int flags, ...) {
  static const auto real = test::realOf<int(const char*, int, ...)>("open");
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  return test::noteOpen(AT_FDCWD, path, flags, [&] { return real(path, flags, mode); });
}
ISOBRICK_SAME(int, open, const char* path, int flags, ...);

ISOBRICK_RECORDED(int, openat, int folder, const char* path, int flags, ...) {
  static const auto real = test::realOf<int(int, const char*, int, ...)>("openat");
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  return test::noteOpen(folder, path, flags, [&] { return real(folder, path, flags, mode); });
}
ISOBRICK_SAME(int, openat, int folder, const char* path, int flags, ...);

ISOBRICK_RECORDED(std::FILE*, fopen, const char* path, const char* how) {
  static const auto real = test::realOf<std::FILE*(const char*, const char*)>("fopen");
  std::FILE* file = nullptr;
  const auto open = [&] {
    file = real(path, how);
    return file == nullptr ? -1 : fileno(file);
  };
  const int flags = *how == 'r' ? 0 : *how == 'a' ? O_CREAT : O_CREAT | O_TRUNC;
  test::noteOpen(AT_FDCWD, path, flags, open);
  return file;
}
ISOBRICK_SAME(std::FILE*, fopen, const char* path, const char* how);

ISOBRICK_RECORDED(int, mkostemp, char* path, int flags) {
  static const auto real = test::realOf<int(char*, int)>("mkostemp");
  return test::noting([&] { return real(path, flags); },
                      [&](int fd) {
                        struct stat status = {};
                        if (fstat(fd, &status) == 0)
                          test::noteNew(ChangeKind::kFile, test::nameIn(AT_FDCWD, path), status);
                      });
}
ISOBRICK_SAME(int, mkostemp, char* path, int flags);

ISOBRICK_RECORDED(int, mkdir, const char* path, mode_t mode) {
  static const auto real = test::realOf<int(const char*, mode_t)>("mkdir");
  return test::noting([&] { return real(path, mode); },
                      [&](int) {
                        struct stat status = {};
                        if (lstat(path, &status) == 0)
                          test::noteNew(ChangeKind::kFolder, test::nameIn(AT_FDCWD, path), status);
                      });
}

ISOBRICK_RECORDED(ssize_t, write, int fd, const void* data, size_t bytes) {
  static const auto real = test::realOf<ssize_t(int, const void*, size_t)>("write");
  return test::noting([&] { return real(fd, data, bytes); },
                      [&](ssize_t done) {
                        if (test::knownFile(fd))
                          test::noteWrite(fd, test::positionBefore(fd, done), data,
                                          static_cast<size_t>(done));
                      });
}
ISOBRICK_RECORDED(ssize_t, writev, int fd, const iovec* pieces, int count) {
  static const auto real = test::realOf<ssize_t(int, const iovec*, int)>("writev");
  return test::noting([&] { return real(fd, pieces, count); },
                      [&](ssize_t done) {
                        if (!test::knownFile(fd)) return;
                        const std::string all =
                            test::gathered(pieces, count, static_cast<size_t>(done));
                        test::noteWrite(fd, test::positionBefore(fd, done), all.data(), all.size());
                      });
}
ISOBRICK_RECORDED(ssize_t, pwrite, int fd, const void* data, size_t bytes, off_t offset) {
  static const auto real = test::realOf<ssize_t(int, const void*, size_t, off_t)>("pwrite");
  return test::noting([&] { return real(fd, data, bytes, offset); },
                      [&](ssize_t done) {
                        test::noteWrite(fd, static_cast<std::uint64_t>(offset), data,
                                        static_cast<size_t>(done));
                      });
}
ISOBRICK_SAME(ssize_t, pwrite, int fd, const void* data, size_t bytes, off_t offset);
ISOBRICK_RECORDED(ssize_t, pwritev, int fd, const iovec* pieces, int count, off_t offset) {
  static const auto real = test::realOf<ssize_t(int, const iovec*, int, off_t)>("pwritev");
  return test::noting(
      [&] { return real(fd, pieces, count, offset); },
      [&](ssize_t done) {
        const std::string all = test::gathered(pieces, count, static_cast<size_t>(done));
        test::noteWrite(fd, static_cast<std::uint64_t>(offset), all.data(), all.size());
      });
}
ISOBRICK_SAME(ssize_t, pwritev, int fd, const iovec* pieces, int count, off_t offset);

ISOBRICK_RECORDED(int, ftruncate, int fd, off_t bytes) {
  static const auto real = test::realOf<int(int, off_t)>("ftruncate");
  return test::noting([&] { return real(fd, bytes); }, [&](int) { test::noteSize(fd); });
}
ISOBRICK_SAME(int, ftruncate, int fd, off_t bytes);
ISOBRICK_RECORDED(int, fallocate, int fd, int mode, off_t offset, off_t bytes) {
  static const auto real = test::realOf<int(int, int, off_t, off_t)>("fallocate");
  return test::noting([&] { return real(fd, mode, offset, bytes); },
                      [&](int) { test::noteSize(fd); });
}
ISOBRICK_SAME(int, fallocate, int fd, int mode, off_t offset, off_t bytes);

ISOBRICK_RECORDED(int, rename, const char* from, const char* to) {
  static const auto real = test::realOf<int(const char*, const char*)>("rename");
  return test::noteTwoNames(ChangeKind::kRename, from, to, [&] { return real(from, to); });
}
// All calls here are AT_FDCWD.
ISOBRICK_RECORDED(int, renameat2, int a, const char* from, int b, const char* to, unsigned flags) {
  static const auto real =
      test::realOf<int(int, const char*, int, const char*, unsigned)>("renameat2");
  const bool exchanges = (flags & RENAME_EXCHANGE) != 0;
  return test::noteTwoNames(exchanges ? ChangeKind::kExchange : ChangeKind::kRename, from, to,
                            [&] { return real(a, from, b, to, flags); });
}
ISOBRICK_RECORDED(int, link, const char* from, const char* to) {
  static const auto real = test::realOf<int(const char*, const char*)>("link");
  return test::noteTwoNames(ChangeKind::kLink, from, to, [&] { return real(from, to); });
}

ISOBRICK_RECORDED(int, unlink, const char* path) {
  static const auto real = test::realOf<int(const char*)>("unlink");
  return test::noteRemoval(AT_FDCWD, path, [&] { return real(path); });
}
ISOBRICK_RECORDED(int, remove, const char* path) {
  static const auto real = test::realOf<int(const char*)>("remove");
  return test::noteRemoval(AT_FDCWD, path, [&] { return real(path); });
}
ISOBRICK_RECORDED(int, rmdir, const char* path) {
  static const auto real = test::realOf<int(const char*)>("rmdir");
  return test::noteRemoval(AT_FDCWD, path, [&] { return real(path); });
}
ISOBRICK_RECORDED(int, unlinkat, int folder, const char* path, int flags) {
  static const auto real = test::realOf<int(int, const char*, int)>("unlinkat");
  return test::noteRemoval(folder, path, [&] { return real(folder, path, flags); });
}

ISOBRICK_RECORDED(int, fsync, int fd) {
  static const auto real = test::realOf<int(int)>("fsync");
  return test::noting([&] { return real(fd); }, [&](int) { test::noteSync(fd); });
}
ISOBRICK_RECORDED(int, fdatasync, int fd) {
  static const auto real = test::realOf<int(int)>("fdatasync");
  return test::noting([&] { return real(fd); }, [&](int) { test::noteSync(fd); });
}
ISOBRICK_RECORDED(int, syncfs, int fd) {
  static const auto real = test::realOf<int(int)>("syncfs");
  return test::noting([&] { return real(fd); },
                      [&](int) { test::add(ChangeKind::kSyncAll, 0, 0); });
}

}  // extern "C"
// NOLINTEND
