#include "isobrick/storage/file_io.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

namespace isobrick {
namespace {

constexpr std::size_t kMostPerCall = std::size_t{1} << 30;  // Linux moves less than 2^31 bytes
constexpr auto kMostOffset = static_cast<std::uint64_t>(std::numeric_limits<off_t>::max());

// Calls `call(bytes done, bytes to do)`, which is a read or a write, until all is done, a call
// fails or a call does nothing.
template <typename Call>
IoResult repeat(std::size_t bytes, Call&& call) {
  IoResult result;
  while (result.bytes < bytes) {
    const ssize_t done = call(result.bytes, std::min(bytes - result.bytes, kMostPerCall));
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) result.error = errno;
    if (done <= 0) break;
    result.bytes += static_cast<std::size_t>(done);
  }
  return result;
}

template <typename Call>
IoResult repeatWrite(std::size_t bytes, Call&& call) {
  IoResult result = repeat(bytes, call);
  if (result.bytes < bytes && result.error == 0) result.error = ENOSPC;
  return result;
}

// An offset behind the last possible one would be negative to the system.
bool isPossible(std::uint64_t offset, std::size_t bytes) {
  return bytes <= kMostOffset && offset <= kMostOffset - bytes;
}

// Leaves out the first `bytes` bytes, and spans of none.
std::span<iovec> skip(std::span<iovec> spans, std::size_t bytes) {
  while (!spans.empty() && spans.front().iov_len <= bytes) {
    bytes -= spans.front().iov_len;
    spans = spans.subspan(1);
  }
  if (!spans.empty()) {
    spans.front().iov_base = static_cast<char*>(spans.front().iov_base) + bytes;
    spans.front().iov_len -= bytes;
  }
  return spans;
}

}  // namespace

IoResult readBytesAt(int fd, std::uint64_t offset, void* out, std::size_t bytes) {
  return repeat(bytes, [&](std::size_t done, std::size_t rest) -> ssize_t {
    if (!isPossible(offset, done + rest)) return 0;
    return pread(fd, static_cast<char*>(out) + done, rest, static_cast<off_t>(offset + done));
  });
}

IoResult writeBytesAt(int fd, std::uint64_t offset, const void* data, std::size_t bytes) {
  if (!isPossible(offset, bytes)) return {0, EFBIG};
  return repeatWrite(bytes, [&](std::size_t done, std::size_t rest) {
    return pwrite(fd, static_cast<const char*>(data) + done, rest,
                  static_cast<off_t>(offset + done));
  });
}

IoResult writeBytesAt(int fd, std::uint64_t offset, std::span<iovec> spans) {
  std::size_t bytes = 0, skipped = 0;
  for (const iovec& span : spans) bytes += span.iov_len;
  if (!isPossible(offset, bytes)) return {0, EFBIG};
  return repeatWrite(bytes, [&](std::size_t done, std::size_t) {
    spans = skip(spans, done - skipped);
    skipped = done;
    return pwritev(fd, spans.data(), static_cast<int>(spans.size()),
                   static_cast<off_t>(offset + done));
  });
}

IoResult writeNextBytes(int fd, const void* data, std::size_t bytes) {
  return repeatWrite(bytes, [&](std::size_t done, std::size_t rest) {
    return write(fd, static_cast<const char*>(data) + done, rest);
  });
}

std::string ioFailureText(std::uint64_t offset, const IoResult& result) {
  return "at byte " + std::to_string(offset + result.bytes) + ": " +
         (result.error != 0 ? std::strerror(result.error) : "it is shorter than it was");
}

}  // namespace isobrick
