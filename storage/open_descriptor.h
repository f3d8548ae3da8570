// An open file's descriptor that is closed with its owner.
#pragma once

#include <unistd.h>

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

}  // namespace isobrick
