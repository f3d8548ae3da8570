// The source of a pyramid's bytes: one seam, with a local file or a server behind it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include "isobrick/storage/file_io.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

// Some bytes of a file.
struct ByteRange {
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
};

// Bytes that cannot be read, or are damaged. what() follows the name of the bytes in a sentence:
// "cannot be read: ...", and behind a semicolon what to do, if that is known here.
class ReadFailure : public std::runtime_error {
 public:
  explicit ReadFailure(
      const std::string& what = "cannot be read (the file was cut short or its disk failed)")
      : std::runtime_error(what) {}
};

// Reads ranges of one file, whose size does not change. All members are thread-safe; no thread may
// use the object while it is made or destroyed.
class RangeReader {
 public:
  RangeReader() = default;
  virtual ~RangeReader() = default;
  RangeReader(const RangeReader&) = delete;
  RangeReader& operator=(const RangeReader&) = delete;

  virtual std::uint64_t size() const = 0;

  // Copies a range that lies in the file to `out`, and waits for that. Throws ReadFailure.
  virtual void read(const ByteRange& range, std::byte* out) = 0;

  // Says that these ranges will be read soon, each as a whole. Begins to bring them in and waits
  // for nothing. May do less, or nothing.
  virtual void announce(std::span<const ByteRange> ranges) = 0;

  // Reads that wait end at once, as failed, and so do all later ones: their results are not wanted.
  virtual void abandon() {}

  // A text that no other file behind a URL has, and no other edition of this one; "" for a file of
  // this machine.
  virtual std::string identity() const { return {}; }
  virtual RemoteCounters counters() const { return {}; }
};

// Ranges of a file of this machine.
class FileRanges final : public RangeReader {
 public:
  // Throws Error if the file cannot be opened, is not a regular file, or is empty.
  explicit FileRanges(const std::string& path);

  // Open for reading, as long as this object lives.
  int fd() const { return file_.get(); }

  std::uint64_t size() const override { return size_; }
  void read(const ByteRange& range, std::byte* out) override;
  // Asks the system to bring the bytes into its page cache.
  void announce(std::span<const ByteRange> ranges) override;
  // True if the page cache has the first and the last of these bytes, at least 1: what the disk
  // brings, it brings as a whole. False on file systems that do not say.
  bool isCached(const ByteRange& range) const;

 private:
  OpenDescriptor file_;
  std::uint64_t size_ = 0;
};

// The failure and what to do: `advice`, unless `failure` says that itself.
inline std::string withAdvice(const std::string& failure, const char* advice) {
  return failure.find(';') == std::string::npos ? failure + "; " + advice : failure;
}

}  // namespace isobrick
