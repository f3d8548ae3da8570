// A read-only file in memory whose failures are errors rather than crashes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "isobrick/storage/bus_error_guard.h"

namespace isobrick {

// Maps a whole file for reading. All const members are thread-safe, none is safe in a signal
// handler; nobody may use the object while it is made or destroyed.
//
// A page that cannot be had when it is touched (the file was cut, its disk failed) reads as zeros
// (see BusErrorGuard, also for what becomes of other handlers of SIGBUS). So whoever used mapped
// bytes asks failedOffset() before the result is believed. Once a page has failed, the file stays
// failed.
class MappedFile {
 public:
  // Throws Error where the file cannot be opened or mapped, is empty, or too many are open at once
  // (kMostFiles).
  explicit MappedFile(const std::string& path);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  static constexpr std::size_t kMostFiles = BusErrorGuard::kMostRanges;

  const std::string& path() const { return path_; }
  const std::byte* data() const { return data_; }
  std::uint64_t size() const { return size_; }

  // Where the first page that could not be read begins.
  std::optional<std::uint64_t> failedOffset() const { return guard_.failedOffset(); }

  // XXH3-64 of `bytes` bytes from `offset`, asked from the disk as one piece; leaves the pages
  // resident. False where a page cannot be read.
  [[nodiscard]] bool checksum(std::uint64_t offset, std::uint64_t bytes,
                              std::uint64_t* result) const;

  // Copies `bytes` bytes from `offset` to `out`, past the map: what was copied is the caller's
  // alone and stays as it is, whatever happens to the file. False where they cannot be read.
  [[nodiscard]] bool read(std::uint64_t offset, std::uint64_t bytes, std::byte* out) const;

  // True while the file is still long enough to hold the piece, and no page has failed.
  bool reaches(std::uint64_t offset, std::uint64_t bytes) const;

  // Gives the pages of the piece back to the system, and those that reading it may have mapped
  // around it. Pages of a neighbour among them stay readable and come from the page cache again.
  void release(std::uint64_t offset, std::uint64_t bytes) const;

 private:
  std::string path_;
  const std::byte* data_ = nullptr;
  std::uint64_t size_ = 0;
  int fd_ = -1;
  BusErrorGuard guard_;
};

}  // namespace isobrick
