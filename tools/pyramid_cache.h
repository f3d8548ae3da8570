// The folder of pyramids that commands built of the volumes that they were given.
//
// A pyramid there is called by the hash of what it was made of and how ("0123456789abcdef.isb"), so
// a volume is found again wherever it lies, and one that changed gets another. Files of other names
// are left alone. Several processes share the folder:
//
// - A pyramid gets its name when it is whole (storage/atomic_file.h).
// - Who builds one holds a CacheBuildLock; others that want the same wait for it.
// - Who uses one holds a shared lock (flock) on the file; such a pyramid is not removed.
#pragma once

#include <cstdint>
#include <ctime>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

// Bytes of all pyramids in the cache, unless ISOBRICK_CACHE_SIZE says otherwise.
inline constexpr std::uint64_t kDefaultCacheBytes = std::uint64_t{32} << 30;

// "$XDG_CACHE_HOME/isobrick", else "~/.cache/isobrick". Throws Error where neither is known.
std::string defaultCacheFolder();

// ISOBRICK_CACHE_SIZE ("64G"), else kDefaultCacheBytes. Throws Error for what is no size.
std::uint64_t cacheBound();

// Where the pyramid of this identity (preprocess/pyramid_builder.h) lies in the cache `folder`,
// which is made where it is missing. Throws Error where that fails.
std::string pathInCache(const std::string& folder, const std::string& identity);

// One process at a time has the lock of a pyramid in the cache.
class CacheBuildLock {
 public:
  // Waits until it has the lock. Throws Cancelled, and Error where the folder cannot be written.
  CacheBuildLock(const std::string& pyramid, const CancelFlag& cancel);
  ~CacheBuildLock();
  CacheBuildLock(const CacheBuildLock&) = delete;
  CacheBuildLock& operator=(const CacheBuildLock&) = delete;

 private:
  std::string path_;
  int fd_;
};

// Keeps the pyramid from being removed until this process ends, and notes that it was used now.
// False where it is not there any more.
bool usePyramid(const std::string& path);

struct CachedPyramid {
  std::string path;         // of the pyramid; there is none yet where it is unfinished
  std::uint64_t bytes = 0;  // of all that belongs to it
  std::timespec last_used = {};
  bool is_whole = false;  // else what a build that was stopped left for the next one
};

// All of the cache, the last used first; empty where there is no such folder.
std::vector<CachedPyramid> listCache(const std::string& folder);

struct CacheRemoval {
  std::size_t removed = 0, in_use = 0;
  std::uint64_t bytes = 0;  // of those removed
};

// Removes all that no process uses or builds. Throws Error where a file cannot be removed.
CacheRemoval clearCache(const std::string& folder);

// Removes the least recently used ones until all of them have at most `bound` bytes. Neither
// `newest` nor what is in use goes.
void trimCache(const std::string& folder, std::uint64_t bound, const std::string& newest);

}  // namespace isobrick
