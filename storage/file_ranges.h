// Ranges of a file of this machine.
#pragma once

#include <string>

#include "isobrick/storage/open_descriptor.h"
#include "isobrick/storage/range_reader.h"

namespace isobrick {

class FileRanges final : public RangeReader {
 public:
  // Throws Error if the file cannot be opened, is not a regular file, or is empty.
  explicit FileRanges(const std::string& path);

  // Open for reading, as long as this object lives.
  int fd() const { return file_.get(); }

  std::uint64_t size() const override { return size_; }
  [[nodiscard]] Failure read(const ByteRange& range, std::byte* out) override;
  // Asks the system to bring the bytes into its page cache.
  void announce(std::span<const ByteRange> ranges) override;

 private:
  OpenDescriptor file_;
  std::uint64_t size_ = 0;
};

}  // namespace isobrick
