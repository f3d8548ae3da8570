#include "isobrick/storage/paged_file.h"

#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/divided_ranges.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/part_cache.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote/open_remote.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

// A page fault maps the cached pages around it as well, up to this much (the kernel's default), and
// they count as ours until they are given back.
constexpr std::uint64_t kFaultAroundBytes = 64 * 1024;

const std::uint64_t kPageBytes = static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));

// Whether the page cache has all pages of `bytes` mapped bytes from `begin`, the begin of a page.
bool areCached(std::byte* begin, std::uint64_t bytes) {
  constexpr std::uint64_t kPages = 1024;  // looked at in one call
  unsigned char is_cached[kPages];
  for (std::uint64_t at = 0; at < bytes; at += kPages * kPageBytes) {
    const std::uint64_t some = std::min(bytes - at, kPages * kPageBytes);
    if (mincore(begin + at, some, is_cached) != 0) return false;
    for (std::uint64_t page = 0; page * kPageBytes < some; ++page)
      if ((is_cached[page] & 1) == 0) return false;
  }
  return true;
}

// The reader of no file.
class NoRanges final : public RangeReader {
 public:
  std::uint64_t size() const override { return 0; }
  void read(const ByteRange&, std::byte*) override { throw ReadFailure(); }
  void announce(std::span<const ByteRange>) override {}
};

}  // namespace

// The last page of a file once more: to look at it is no use of the file's map, and says nothing of
// its other pages.
class FileTail {
 public:
  // As PagedFile::PagedFile(); isGuarded() is false if it has no page to look at.
  FileTail(int fd, std::uint64_t file_bytes) : bytes_((file_bytes - 1) % kPageBytes + 1) {
    void* const map =
        mmap(nullptr, bytes_, PROT_READ, MAP_SHARED, fd, static_cast<off_t>(file_bytes - bytes_));
    if (map == MAP_FAILED) return;
    map_ = static_cast<std::byte*>(map);
    is_guarded_ = guard_.guard(map, bytes_);
    if (!is_guarded_) return;
    last_ = map_ + bytes_ - 1;
    while (last_ != map_ && *last_ == std::byte{}) --last_;
    value_ = *last_;
  }
  ~FileTail() {
    guard_.leave();
    if (map_ != nullptr) munmap(map_, bytes_);
  }
  FileTail(const FileTail&) = delete;

  bool isGuarded() const { return is_guarded_; }
  bool isThere() const {
    const std::byte now = *static_cast<const volatile std::byte*>(last_);
    return now == value_ && !guard_.failedOffset();
  }

 private:
  const std::uint64_t bytes_;
  std::byte* map_ = nullptr;
  const std::byte* last_ = nullptr;  // that is not zero
  std::byte value_{};
  bool is_guarded_ = false;
  BusErrorGuard guard_;
};

PagedFile::PagedFile(const std::string& path, FileAccess access, const RemoteOptions& remote)
    : path_(path) {
  if (isRemotePath(path)) {
    is_remote_ = true;
    url_ = path;
    path_ = withoutSecrets(path);
    connections_ = makeHttpConnections(remote);
    reader_ = openRemoteRanges(path, remote, connections_);
    if (!remote.cache_folder.empty() && remote.cache_bytes > 0)
      kept_ =
          std::make_unique<PartCache>(remote.cache_folder, remote.cache_bytes, reader_->identity());
  } else {
    auto local = std::make_unique<FileRanges>(path);
    local_ = local.get();
    reader_ = std::move(local);
  }
  size_ = reader_->size();
  if (!isRemote() && access == FileAccess::kMap) map();
}

PagedFile::PagedFile() : reader_(std::make_unique<NoRanges>()) {}

void PagedFile::map() {
  stamp_ = stamp();
  void* const map = mmap(nullptr, size_, PROT_READ, MAP_SHARED, local_->fd(), 0);
  if (map == MAP_FAILED)
    throw Error("cannot map '" + path_ + "': " + std::strerror(errno) +
                    "; raise the limit on virtual memory or open it without a map",
                {.path = path_});
  tail_ = std::make_unique<FileTail>(local_->fd(), size_);
  if (!tail_->isGuarded() || !guard_.guard(map, size_)) {
    munmap(map, size_);
    throw Error("cannot open '" + path_ + "': " + std::to_string(kMostFiles) +
                    " pyramids are open already; close some",
                {.path = path_});
  }
  data_ = static_cast<const std::byte*>(map);
  // Bricks are asked for as a whole; the kernel's guess around a fault would read others too.
  madvise(map, size_, MADV_RANDOM);
}

void PagedFile::unmap() {
  guard_.leave();
  if (data_ != nullptr) munmap(const_cast<std::byte*>(data_), size_);
  data_ = nullptr;
}

PagedFile::~PagedFile() { unmap(); }

void PagedFile::divide(std::shared_ptr<const PyramidDivision> division,
                       const RemoteOptions& remote) {
  unmap();
  tail_.reset();
  local_ = nullptr;
  DividedRanges::Files files;
  files.division = std::move(division);
  files.are_remote = is_remote_;
  files.path_of = [url = is_remote_ ? url_ : path_](const std::string& name) {
    return besidePath(url, name);
  };
  if (is_remote_)
    files.open = [remote, connections = connections_](const std::string& path,
                                                      const CancelFlag& cancel) {
      RemoteOptions options = remote;
      options.cancel = &cancel;
      return openRemoteRanges(path, options, connections);
    };
  else
    files.open = [](const std::string& path, const CancelFlag&) -> std::unique_ptr<RangeReader> {
      return std::make_unique<FileRanges>(path);
    };
  auto ranges = std::make_unique<DividedRanges>(std::move(reader_), std::move(files));
  divided_ = ranges.get();
  reader_ = std::move(ranges);
  size_ = reader_->size();
}

ErrorPlace PagedFile::place(std::uint64_t offset) const {
  if (divided_ != nullptr)
    if (const auto place = divided_->place(offset))
      return {.path = place->path, .offset = place->offset};
  return {.path = path_, .offset = offset};
}

std::string PagedFile::offsetText(std::uint64_t offset) const {
  const ErrorPlace place = this->place(offset);
  std::string text = "offset " + std::to_string(*place.offset);
  if (place.path != path_) text += " of '" + place.path + "'";
  return text;
}

bool PagedFile::isWhole() const {
  return !isMapped() || (tail_->isThere() && !guard_.failedOffset());
}

bool PagedFile::reaches(std::uint64_t offset, std::uint64_t bytes) const {
  if (!isMapped()) return true;
  BusErrorGuard::keepInFront();
  struct stat status = {};
  return !failedOffset(offset, bytes) && fstat(local_->fd(), &status) == 0 &&
         static_cast<std::uint64_t>(status.st_size) >= offset + bytes;
}

PagedFile::Stamp PagedFile::stamp() const {
  constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;
  struct stat status = {};
  if (fstat(local_->fd(), &status) != 0) return {};
  return {std::int64_t{status.st_mtim.tv_sec} * kNanosecondsPerSecond + status.st_mtim.tv_nsec,
          status.st_size};
}

std::uint64_t PagedFile::edition() const {
  if (!isMapped()) return 0;
  const std::lock_guard lock(mutex_);
  const Stamp now = stamp();
  if (now != stamp_) ++edition_;
  stamp_ = now;
  return edition_;
}

std::uint64_t PagedFile::checksum(std::uint64_t offset, std::uint64_t bytes) const {
  BusErrorGuard::keepInFront();
  const std::uint64_t begin = offset / kPageBytes * kPageBytes;
  std::byte* from = const_cast<std::byte*>(data_ + begin);
  // A fault maps 16 pages that are cached, in less time than populating takes for two of them.
  if (!areCached(from, offset + bytes - begin)) {
    madvise(from, offset + bytes - begin, MADV_WILLNEED);
    // One call in place of a fault for every page. Kernels before 5.14 do not know it (EINVAL).
    if (madvise(from, offset + bytes - begin, MADV_POPULATE_READ) != 0 && errno != EINVAL)
      throw ReadFailure();
  }
  const std::uint64_t result = checksum64(data_ + offset, bytes);
  if (failedOffset(offset, bytes)) throw ReadFailure();
  return result;
}

bool PagedFile::readKept(std::uint64_t checksum, std::uint64_t bytes, std::byte* out) const {
  if (kept_ == nullptr || !kept_->read(checksum, bytes, out)) return false;
  ++kept_parts_;
  kept_bytes_ += bytes;
  return true;
}

void PagedFile::keep(std::uint64_t checksum, std::uint64_t bytes, const std::byte* data) const {
  if (kept_ != nullptr) kept_->write(checksum, bytes, data);
}

bool PagedFile::isKept(std::uint64_t checksum, std::uint64_t bytes) const {
  return kept_ != nullptr && kept_->has(checksum, bytes);
}

RemoteCounters PagedFile::remoteCounters() const {
  RemoteCounters counters = reader_->counters();
  counters.cached_parts = kept_parts_;
  counters.cached_bytes = kept_bytes_;
  return counters;
}

void PagedFile::release(std::uint64_t offset, std::uint64_t bytes) const {
  const std::uint64_t begin = offset / kFaultAroundBytes * kFaultAroundBytes;
  const std::uint64_t end = std::min(
      size_, (offset + bytes + kFaultAroundBytes - 1) / kFaultAroundBytes * kFaultAroundBytes);
  madvise(const_cast<std::byte*>(data_ + begin), end - begin, MADV_DONTNEED);
}

}  // namespace isobrick
