// A read-only file, of this machine or behind a URL, whose parts are used in place in its map, or
// read.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>

#include "isobrick/storage/bus_error_guard.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_info.h"  // FileAccess
#include "isobrick/storage/range_reader.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

class DividedRanges;
class FileRanges;
class FileTail;
class PartCache;
class PyramidDivision;
struct HttpConnections;

// Opens a whole file for reading and, with kMap, maps it; a file behind a URL is never mapped. All
// const members are thread-safe, none is safe in a signal handler; no thread may use the object
// while it is made or destroyed.
//
// A page that cannot be read when it is touched (the file was cut, its disk failed) reads as zeros
// from then on (see BusErrorGuard, also for other handlers of SIGBUS). So code that used mapped
// bytes asks failedOffset() of them before it believes the result. Bytes that are read are a copy,
// and a failure to read them is known at once.
class PagedFile {
 public:
  // Throws Error if the file cannot be opened or mapped, is empty, or too many are mapped at
  // once (kMostFiles).
  explicit PagedFile(const std::string& path, FileAccess access = FileAccess::kMap,
                     const RemoteOptions& remote = {});
  // No file, of no bytes.
  PagedFile();
  ~PagedFile();
  PagedFile(const PagedFile&) = delete;
  PagedFile& operator=(const PagedFile&) = delete;

  static constexpr std::size_t kMostFiles = BusErrorGuard::kMostRanges / 2;

  // For the index of a divided pyramid: from now on the bytes are those of all its files, of which
  // none is mapped. Before any other thread uses this object.
  void divide(std::shared_ptr<const PyramidDivision> division, const RemoteOptions& remote);

  const std::string& path() const { return path_; }
  // The sum over all files if it was divided.
  std::uint64_t size() const { return size_; }
  bool isRemote() const { return is_remote_; }
  // The file, of a divided pyramid, with this offset, and the offset in it.
  ErrorPlace place(std::uint64_t offset) const;
  // "offset 17", or "offset 17 of 'scan.isbs/0-0-1.isb'".
  std::string offsetText(std::uint64_t offset) const;
  // True if [offset, offset + bytes) lies in the file; safe against overflow.
  bool holds(std::uint64_t offset, std::uint64_t bytes) const {
    return offset <= size_ && bytes <= size_ - offset;
  }
  bool isMapped() const { return data_ != nullptr; }

  // Copies `bytes` bytes from `offset` to `out`, past the map: the copy is the caller's alone and
  // stays as it is, whatever happens to the file. Throws ReadFailure.
  void read(std::uint64_t offset, std::uint64_t bytes, std::byte* out) const {
    reader_->read({offset, bytes}, out);
  }

  // Copies a part, bytes with a checksum, from the folder of RemoteOptions to `out`; false if it is
  // not there, as for a local file. keep() puts a part there that came from the server instead.
  [[nodiscard]] bool readKept(std::uint64_t checksum, std::uint64_t bytes, std::byte* out) const;
  void keep(std::uint64_t checksum, std::uint64_t bytes, const std::byte* data) const;
  bool isKept(std::uint64_t checksum, std::uint64_t bytes) const;

  // Asks the system to bring these bytes into its page cache, or the server to send them, and waits
  // for nothing. Ranges that are announced together may be sent together.
  void announce(std::span<const ByteRange> ranges) const { reader_->announce(ranges); }

  // Ends reads that wait for a server, and all later ones: see RangeReader::abandon().
  void abandonReads() const { reader_->abandon(); }
  RemoteCounters remoteCounters() const;
  // See RangeReader::identity().
  std::string identity() const { return reader_->identity(); }

  // ---- of a mapped file ----

  // As FileRanges::isCached(); false if the file is not mapped.
  bool isCached(const ByteRange& range) const { return isMapped() && local_->isCached(range); }

  const std::byte* data() const { return data_; }

  // The offset of the page that was the first that could not be read; none while all could be.
  std::optional<std::uint64_t> failedOffset() const { return guard_.failedOffset(); }
  // The same of the lowest such page with any of these bytes, at least 1, which lie in the file.
  std::optional<std::uint64_t> failedOffset(std::uint64_t offset, std::uint64_t bytes) const {
    return guard_.failedOffset(offset, bytes);
  }

  // XXH3-64 of `bytes` bytes from `offset`, asked from the disk in one go; leaves the pages
  // resident. Throws ReadFailure if a page cannot be read.
  std::uint64_t checksum(std::uint64_t offset, std::uint64_t bytes) const;

  // Gives the pages of these bytes back to the system, and those that reading it may have mapped
  // around it. Pages of a neighbour among them stay readable and come from the page cache again.
  void release(std::uint64_t offset, std::uint64_t bytes) const;

  // ---- what happened to it; of a file that is not mapped always that all is well ----

  // True while no page has failed and the file was not cut: without a system call, for it looks at
  // the last byte of the file that is not zero, which a cut takes away or makes zero. A cut behind
  // it changes no byte of the map. If this is false, reaches() says which bytes are still there.
  bool isWhole() const;

  // True while the file is still long enough to hold these bytes, and none of their pages failed.
  bool reaches(std::uint64_t offset, std::uint64_t bytes) const;

  // How often this function found the file written to: the map may then have other bytes than were
  // checked. Asks the system for the file's size and the time of its last change, which a program
  // that writes through a map of its own may change late or never.
  std::uint64_t edition() const;

 private:
  // When the file was written to, in nanoseconds, and its size.
  struct Stamp {
    std::int64_t written = 0, bytes = 0;
    bool operator==(const Stamp&) const = default;
  };
  Stamp stamp() const;
  void map();
  void unmap();

  std::string path_;
  bool is_remote_ = false;
  std::string url_;  // with what path_ leaves out
  const std::byte* data_ = nullptr;
  std::shared_ptr<HttpConnections> connections_;  // of a remote one and its files
  std::unique_ptr<RangeReader> reader_;
  const FileRanges* local_ = nullptr;       // the reader of a local file, unless it is divided
  const DividedRanges* divided_ = nullptr;  // the reader of a divided one
  std::unique_ptr<PartCache> kept_;         // of a remote one
  std::uint64_t size_ = 0;
  std::unique_ptr<FileTail> tail_;
  BusErrorGuard guard_;
  mutable std::mutex mutex_;  // guards the two below
  mutable Stamp stamp_;
  mutable std::uint64_t edition_ = 0;
  mutable std::atomic<std::uint64_t> kept_parts_{0}, kept_bytes_{0};  // that were read
};

}  // namespace isobrick
