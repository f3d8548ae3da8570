#include "tools/pyramid_cache.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <map>
#include <string_view>
#include <system_error>
#include <tuple>
#include <utility>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_writer.h"
#include "tools/parse_text.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kHashDigits = 16;
constexpr std::string_view kPyramidEnding = ".isb", kLockEnding = ".lock",
                           kJournalEnding = ".journal";

// False if another process has it. On a file system without locks, assumes that there is none.
bool tryLock(int fd, int kind) {
  int failed = 0;
  do failed = flock(fd, kind | LOCK_NB);
  while (failed != 0 && errno == EINTR);
  return failed == 0 || errno != EWOULDBLOCK;
}

// Whether the open file still has the name `path`.
bool hasName(int fd, const std::string& path) {
  struct stat open_file = {}, named = {};
  return fstat(fd, &open_file) == 0 && stat(path.c_str(), &named) == 0 &&
         open_file.st_dev == named.st_dev && open_file.st_ino == named.st_ino;
}

// The lock file, locked; -1 if another process has it.
int tryBuildLock(const std::string& path) {
  while (true) {
    OpenDescriptor file(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644));
    if (file.get() < 0)
      throw Error(fmt::format("cannot write to the cache: '{}': {}; choose another folder with "
                              "XDG_CACHE_HOME",
                              path, std::strerror(errno)),
                  {.path = path});
    if (!tryLock(file.get(), LOCK_EX)) return -1;
    // The process that had it before may have removed it.
    if (hasName(file.get(), path)) return file.release();
  }
}

// The files of one pyramid, beside the file itself.
std::string lockPath(const std::string& pyramid) { return pyramid + std::string(kLockEnding); }
std::string unfinishedPath(const std::string& pyramid) { return pyramid + kUnfinishedEnding; }
std::string journalPath(const std::string& pyramid) {
  return unfinishedPath(pyramid) + std::string(kJournalEnding);
}

// "0123456789abcdef.isb" for a file of that pyramid; empty for other files.
std::string pyramidNameOf(const std::string& file) {
  const std::size_t length = kHashDigits + kPyramidEnding.size();
  if (file.size() < length || file.compare(kHashDigits, kPyramidEnding.size(), kPyramidEnding) != 0)
    return {};
  if (file.find_first_not_of("0123456789abcdef") != kHashDigits) return {};
  std::string name = file.substr(0, length);
  for (const std::string& whole : {name, lockPath(name), unfinishedPath(name), journalPath(name)})
    if (file == whole) return name;
  return {};
}

// Does nothing if there is no such file. Throws Error if it cannot be removed.
void removeFile(const std::string& path) {
  if (unlink(path.c_str()) == 0 || errno == ENOENT) return;
  throw Error(fmt::format("cannot remove '{}': {}", path, std::strerror(errno)), {.path = path});
}

// False if a process uses or builds it.
bool removeUnlessUsed(const CachedPyramid& entry) {
  const std::string lock_path = lockPath(entry.path);
  const OpenDescriptor lock(tryBuildLock(lock_path));
  if (lock.get() < 0) return false;
  const OpenDescriptor file(open(entry.path.c_str(), O_RDONLY | O_CLOEXEC));
  const bool is_free = file.get() < 0 || tryLock(file.get(), LOCK_EX);
  if (is_free)
    for (const std::string& path :
         {entry.path, unfinishedPath(entry.path), journalPath(entry.path)})
      removeFile(path);
  removeFile(lock_path);
  return is_free;
}

bool isLater(const std::timespec& a, const std::timespec& b) {
  return std::tie(a.tv_sec, a.tv_nsec) > std::tie(b.tv_sec, b.tv_nsec);
}

}  // namespace

std::string defaultCacheFolder() {
  // The specification ignores relative ones.
  for (const auto& [variable, below] :
       {std::pair{"XDG_CACHE_HOME", "isobrick"}, std::pair{"HOME", ".cache/isobrick"}}) {
    const char* const folder = std::getenv(variable);
    if (folder != nullptr && folder[0] == '/') return (fs::path(folder) / below).string();
  }
  throw Error(
      "there is no folder for the pyramids of volumes: neither XDG_CACHE_HOME nor HOME is the "
      "path of one; set one of them");
}

std::uint64_t cacheBound() {
  const char* const text = std::getenv("ISOBRICK_CACHE_SIZE");
  if (text == nullptr || *text == '\0') return kDefaultCacheBytes;
  try {
    return parseByteSize(text);
  } catch (const std::invalid_argument& wrong) {
    throw Error(
        fmt::format("ISOBRICK_CACHE_SIZE is no size: {}; set it to one such as 64G", wrong.what()));
  }
}

void makeCacheFolder(const std::string& folder) {
  if (const std::error_code failure = makeFolders(folder))
    throw Error(fmt::format("cannot make the folder '{}' of the cache: {}; choose another with "
                            "XDG_CACHE_HOME",
                            folder, failure.message()),
                {.path = folder});
}

std::string pathInCache(const std::string& folder, const std::string& identity) {
  const std::string name = fmt::format("{:0{}x}{}", checksum64(identity.data(), identity.size()),
                                       kHashDigits, kPyramidEnding);
  return (fs::path(folder) / name).string();
}

CacheBuildLock::CacheBuildLock(const std::string& pyramid, const CancelFlag& cancel)
    : path_(lockPath(pyramid)), fd_(tryBuildLock(path_)) {
  constexpr useconds_t kMicrosecondsBetweenLooks = 50000;
  while (fd_ < 0) {
    cancel.check();
    usleep(kMicrosecondsBetweenLooks);
    fd_ = tryBuildLock(path_);
  }
}

CacheBuildLock::~CacheBuildLock() {
  unlink(path_.c_str());
  close(fd_);
}

bool usePyramid(const std::string& path) {
  OpenDescriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0 || !tryLock(file.get(), LOCK_SH) || !hasName(file.get(), path)) return false;
  // Sets the time of the last access, as mounts with noatime do not keep it otherwise.
  const std::timespec times[2] = {{0, UTIME_NOW}, {0, UTIME_OMIT}};
  futimens(file.get(), times);
  file.release();  // open until the process ends
  return true;
}

std::vector<CachedPyramid> listCache(const std::string& folder) {
  std::map<std::string, CachedPyramid> by_name;
  visitFolder(folder, [&](const FolderMember& file) {
    const std::string name = pyramidNameOf(file.name());
    struct stat status = {};
    if (name.empty() || lstat(file.path().c_str(), &status) != 0 || !S_ISREG(status.st_mode))
      return true;
    CachedPyramid& entry = by_name[name];
    entry.path = (fs::path(folder) / name).string();
    entry.bytes += static_cast<std::uint64_t>(status.st_size);
    if (file.path() == entry.path) entry.is_whole = true;
    const std::timespec& used =
        isLater(status.st_atim, status.st_mtim) ? status.st_atim : status.st_mtim;
    if (isLater(used, entry.last_used)) entry.last_used = used;
    return true;
  });
  std::vector<CachedPyramid> entries;
  for (auto& [name, entry] : by_name) entries.push_back(std::move(entry));
  std::stable_sort(entries.begin(), entries.end(),
                   [](const auto& a, const auto& b) { return isLater(a.last_used, b.last_used); });
  return entries;
}

CacheRemoval clearCache(const std::string& folder) {
  CacheRemoval removal;
  for (const CachedPyramid& entry : listCache(folder)) {
    if (!removeUnlessUsed(entry)) {
      ++removal.in_use;
      continue;
    }
    if (entry.bytes > 0) ++removal.removed;  // else a lock file that was left behind
    removal.bytes += entry.bytes;
  }
  return removal;
}

void trimCache(const std::string& folder, std::uint64_t bound, const std::string& newest) {
  const std::vector<CachedPyramid> entries = listCache(folder);
  std::uint64_t total = 0;
  for (const CachedPyramid& entry : entries) total += entry.bytes;
  for (auto entry = entries.rbegin(); entry != entries.rend() && total > bound; ++entry)
    if (entry->path != newest && removeUnlessUsed(*entry)) total -= entry->bytes;
}

}  // namespace isobrick
