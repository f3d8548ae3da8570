// The folder of pyramids that commands built from their input volumes.
//
// A pyramid there is named after the hash of its input and options ("0123456789abcdef.isb"), so a
// volume is found again wherever it lies, and a changed volume gets another pyramid. Files of other
// names are not touched. Several processes share the folder:
//
// - A pyramid gets its name when it is complete (storage/atomic_file.h).
// - A process that builds one holds a CacheBuildLock; others that need the same wait for it.
// - A process that uses one holds a shared lock (flock) on the file; it is then not removed.
#pragma once

#include <cstdint>
#include <ctime>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

// Bytes of all pyramids in the cache, unless ISOBRICK_CACHE_SIZE says otherwise.
inline constexpr std::uint64_t kDefaultCacheBytes = std::uint64_t{32} << 30;

// "$XDG_CACHE_HOME/isobrick", else "~/.cache/isobrick". Throws Error if neither is known.
std::string defaultCacheFolder();

// ISOBRICK_CACHE_SIZE ("64G"), else kDefaultCacheBytes. Throws Error for text that is no size.
std::uint64_t cacheBound();

// Makes it if it is missing. Throws Error if that fails.
void makeCacheFolder(const std::string& folder);

// The path of the pyramid of this identity (preprocess/pyramid_builder.h) in the cache `folder`.
std::string pathInCache(const std::string& folder, const std::string& identity);

// One process at a time has the lock of a pyramid in the cache.
class CacheBuildLock {
 public:
  // Waits until it has the lock. Throws Cancelled, and Error if the folder cannot be written.
  CacheBuildLock(const std::string& pyramid, const CancelFlag& cancel);
  ~CacheBuildLock();
  CacheBuildLock(const CacheBuildLock&) = delete;
  CacheBuildLock& operator=(const CacheBuildLock&) = delete;

 private:
  std::string path_;
  int fd_;
};

// Keeps the pyramid from being removed until this process ends, and notes that it was used now.
// False if it is not there any more.
bool usePyramid(const std::string& path);

struct CachedPyramid {
  std::string path;         // of the pyramid; no file yet if it is unfinished
  std::uint64_t bytes = 0;  // of all its files
  std::timespec last_used = {};
  bool is_whole = false;  // false: a stopped build left it for the next one
};

// All of the cache, the last used first; empty if there is no such folder.
std::vector<CachedPyramid> listCache(const std::string& folder);

struct CacheRemoval {
  std::size_t removed = 0, in_use = 0;
  std::uint64_t bytes = 0;  // of those removed
};

// Removes all that no process uses or builds. Throws Error if a file cannot be removed.
CacheRemoval clearCache(const std::string& folder);

// Removes the least recently used ones until all of them have at most `bound` bytes. Keeps `newest`
// and all that are in use.
void trimCache(const std::string& folder, std::uint64_t bound, const std::string& newest);

}  // namespace isobrick
