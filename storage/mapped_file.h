// A read-only file in memory whose failures are errors rather than crashes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace isobrick {

// Maps a whole file for reading. The first mapping installs a handler for SIGBUS (the signal of a
// page that cannot be read because the file was cut or its disk failed). Thread-safe to read.
class MappedFile {
 public:
  // Throws Error where the file cannot be opened or mapped, or is empty.
  explicit MappedFile(const std::string& path);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  const std::string& path() const { return path_; }
  const std::byte* data() const { return data_; }
  std::uint64_t size() const { return size_; }

  // XXH3-64 of `bytes` bytes from `offset`, asked from the disk as one piece; leaves the pages
  // resident. False where a page cannot be read.
  [[nodiscard]] bool checksum(std::uint64_t offset, std::uint64_t bytes,
                              std::uint64_t* result) const;

  // True while the file is still long enough to hold the piece.
  bool reaches(std::uint64_t offset, std::uint64_t bytes) const;

  // Gives the pages of the piece back to the system, and those that reading it may have mapped
  // around it. Pages of a neighbour among them stay readable and come from the page cache again.
  void release(std::uint64_t offset, std::uint64_t bytes) const;

 private:
  std::string path_;
  const std::byte* data_ = nullptr;
  std::uint64_t size_ = 0;
  int fd_ = -1;
};

}  // namespace isobrick
