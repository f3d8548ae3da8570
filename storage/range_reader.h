// The source of a pyramid's bytes: one seam, with a local file or a server behind it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "isobrick/storage/remote_options.h"

namespace isobrick {

// Some bytes of a file.
struct ByteRange {
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
};

// Reads ranges of one file, whose size does not change. All members are thread-safe; no thread may
// use the object while it is made or destroyed.
class RangeReader {
 public:
  // The outcome of a read: null if it succeeded. Otherwise what is wrong ("cannot be read: ...")
  // and, behind a semicolon, what to do; "" if there is no more to say than that the bytes cannot
  // be read. The text lives as long as the reader.
  using Failure = const char*;

  RangeReader() = default;
  virtual ~RangeReader() = default;
  RangeReader(const RangeReader&) = delete;
  RangeReader& operator=(const RangeReader&) = delete;

  virtual std::uint64_t size() const = 0;

  // Copies a range that lies in the file to `out`, and waits for that.
  [[nodiscard]] virtual Failure read(const ByteRange& range, std::byte* out) = 0;

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

// The failure and what to do: `advice`, unless `failure` says that itself.
inline std::string withAdvice(const std::string& failure, const char* advice) {
  return failure.find(';') == std::string::npos ? failure + "; " + advice : failure;
}

}  // namespace isobrick
