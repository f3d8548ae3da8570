#include "isobrick/storage/part_cache.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <utility>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/remote/sha256.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPartsFolder = "parts";
constexpr const char* kUnnamedPart = "tmp-";  // what such names begin with
constexpr std::uint64_t kShares = 16;
// A part that is being written is not so old; what a killed process left is.
constexpr std::time_t kOldSeconds = 3600;

std::string partsFolder(const std::string& folder) { return (fs::path(folder) / kPartsFolder); }

struct PartFile {
  std::pair<std::time_t, long> used;
  std::uint64_t bytes = 0;
  std::string path;
  bool is_unnamed = false;
};

// Calls `f(PartFile)` for every one, in any order; others may remove them meanwhile.
template <typename F>
void forEachPart(const std::string& folder, F&& f) {
  const auto visitPart = [&](const FolderMember& part) {
    struct stat status = {};
    if (lstat(part.path().c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return true;
    const std::pair accessed(status.st_atim.tv_sec, status.st_atim.tv_nsec);
    const std::pair written(status.st_mtim.tv_sec, status.st_mtim.tv_nsec);
    const bool is_unnamed = part.name().rfind(kUnnamedPart, 0) == 0;
    // Nobody uses an unnamed one: whoever reads all files, as a backup does, makes it no younger.
    f(PartFile{is_unnamed ? written : std::max(accessed, written),
               static_cast<std::uint64_t>(status.st_size), part.path().string(), is_unnamed});
    return true;
  };
  visitFolder(partsFolder(folder), [&](const FolderMember& pyramid) {
    if (pyramid.isFolder() && !pyramid.isLink()) visitFolder(pyramid.path(), visitPart);
    return true;
  });
}

}  // namespace

PartCache::PartCache(const std::string& folder, std::uint64_t most_bytes,
                     const std::string& identity)
    : root_(folder),
      folder_(fs::path(partsFolder(folder)) / sha256(identity).substr(0, 32)),
      most_bytes_(most_bytes),
      written_(most_bytes) {
  if (const std::error_code failure = makeFolders(folder_))
    throw Error("cannot make the folder '" + folder_ + "' for parts of remote pyramids: " +
                    failure.message() + "; choose another folder for the cache",
                {.path = folder_});
}

std::string PartCache::nameOf(std::uint64_t checksum, std::uint64_t bytes) const {
  std::array<char, 64> name;
  std::snprintf(name.data(), name.size(), "%016llx-%llu", static_cast<unsigned long long>(checksum),
                static_cast<unsigned long long>(bytes));
  return folder_ + "/" + name.data();
}

bool PartCache::has(std::uint64_t checksum, std::uint64_t bytes) const {
  return ::access(nameOf(checksum, bytes).c_str(), R_OK) == 0;
}

bool PartCache::read(std::uint64_t checksum, std::uint64_t bytes, std::byte* out) const {
  const std::string path = nameOf(checksum, bytes);
  const OpenDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (file.get() < 0) return false;
  if (readBytesAt(file.get(), 0, out, bytes).bytes != bytes ||
      !isChecksum(checksum64(out, bytes), checksum)) {
    ::unlink(path.c_str());
    return false;
  }
  // Mounts with noatime do not keep it otherwise.
  const std::array<timespec, 2> times{{{0, UTIME_NOW}, {0, UTIME_OMIT}}};
  futimens(file.get(), times.data());
  return true;
}

void PartCache::write(std::uint64_t checksum, std::uint64_t bytes, const std::byte* data) noexcept
    try {
  if (bytes > most_bytes_ / kShares) return;
  {
    const std::lock_guard lock(mutex_);
    if (written_ + bytes > most_bytes_ / kShares) {
      trimParts(root_, most_bytes_ - most_bytes_ / kShares);
      written_ = 0;
    }
    written_ += bytes;
  }
  const std::string path = nameOf(checksum, bytes);
  const std::string unnamed =
      folder_ + "/" + kUnnamedPart + std::to_string(::getpid()) + "-" + std::to_string(next_++);
  {
    const OpenDescriptor file(
        ::open(unnamed.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600));
    if (file.get() < 0) return;
    if (writeBytesAt(file.get(), 0, data, bytes).bytes != bytes) {
      ::unlink(unnamed.c_str());
      return;
    }
  }
  if (::rename(unnamed.c_str(), path.c_str()) != 0) ::unlink(unnamed.c_str());
} catch (const std::exception&) {  // no memory for names
}

KeptParts keptParts(const std::string& folder) {
  KeptParts kept;
  forEachPart(folder, [&](const PartFile& part) {
    ++kept.count;
    kept.bytes += part.bytes;
  });
  return kept;
}

KeptParts trimParts(const std::string& folder, std::uint64_t most_bytes) {
  KeptParts removed;
  const std::string lock_path = partsFolder(folder) + "/lock";
  const OpenDescriptor lock(
      ::open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  // The look of another process, which takes moments, is waited for: it does not know of what this
  // one is about to write.
  while (lock.get() >= 0 && ::flock(lock.get(), LOCK_EX) != 0 && errno == EINTR) {
  }
  std::vector<PartFile> parts;
  std::uint64_t bytes = 0;
  const std::time_t now = std::time(nullptr);
  forEachPart(folder, [&](PartFile part) {
    bytes += part.bytes;
    // No process uses those any more.
    if (part.is_unnamed) part.used.first = now - part.used.first > kOldSeconds ? 0 : now;
    parts.push_back(std::move(part));
  });
  std::sort(parts.begin(), parts.end(),
            [](const PartFile& a, const PartFile& b) { return a.used < b.used; });
  for (const PartFile& part : parts) {
    if (bytes <= most_bytes) break;
    if (::unlink(part.path.c_str()) != 0) continue;
    bytes -= part.bytes;
    removed.bytes += part.bytes;
    ++removed.count;
    ::rmdir(fs::path(part.path).parent_path().c_str());  // if it was the last one
  }
  return removed;
}

}  // namespace isobrick
