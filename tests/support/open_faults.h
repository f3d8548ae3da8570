// Opening a file fails while a test wants it to, as root's rights cannot be taken away.
#pragma once

#include <string>

namespace isobrick::test {

// While it lives, every open() and stat() of this path in this executable ends with `error`
// (EACCES, EIO, ...). One at a time.
class FaultyOpen {
 public:
  FaultyOpen(const std::string& path, int error);
  ~FaultyOpen();
  FaultyOpen(const FaultyOpen&) = delete;
};

}  // namespace isobrick::test
