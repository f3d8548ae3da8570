// Reading and writing open files: the one place that handles interrupted calls, calls that do a
// part of their work, and offsets that no file has.
#pragma once

#include <sys/uio.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

namespace isobrick {

// Closes the descriptor, unless it is negative, when it goes out of scope.
class OpenDescriptor {
 public:
  explicit OpenDescriptor(int fd) : fd_(fd) {}
  ~OpenDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  OpenDescriptor(OpenDescriptor&& other) noexcept : fd_(other.release()) {}
  int get() const { return fd_; }
  // The caller closes it.
  int release() { return std::exchange(fd_, -1); }

 private:
  int fd_;
};

// The outcome of a request. Callers turn it into an error that names their file and what to do.
struct IoResult {
  std::size_t bytes = 0;  // that were read or written, from the first on
  int error = 0;          // errno of the call that failed; 0: none did
};

// Reads `bytes` bytes from `offset`, which may be hostile. Fewer without an error: the file ends.
// Does not move the position of `fd`; by any number of threads at once, as writeBytesAt().
IoResult readBytesAt(int fd, std::uint64_t offset, void* out, std::size_t bytes);

// Writes all bytes, or fewer with an error (ENOSPC if the system takes none and gives no reason).
IoResult writeBytesAt(int fd, std::uint64_t offset, const void* data, std::size_t bytes);
// The same for several spans of memory one after the other; changes `spans`.
IoResult writeBytesAt(int fd, std::uint64_t offset, std::span<iovec> spans);
// The same at the position of `fd`, which moves behind them.
IoResult writeNextBytes(int fd, const void* data, std::size_t bytes);

// "at byte 4096: Input/output error", for a request at `offset` that was not fulfilled.
std::string ioFailureText(std::uint64_t offset, const IoResult& result);

}  // namespace isobrick
