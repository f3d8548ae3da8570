// Reads of a file that go wrong while a test wants them to.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>

namespace isobrick::test {

enum class ReadFault {
  kIoError,      // EIO
  kEndOfFile,    // no byte is there any more
  kFewBytes,     // each call reads less than it was asked for
  kInterrupted,  // two of three calls are interrupted
};

// While it lives, every pread() of this executable that touches the bytes [begin, end) of the file
// goes wrong. One at a time.
class FaultyReads {
 public:
  FaultyReads(const std::string& path, ReadFault fault, std::uint64_t begin = 0,
              std::uint64_t end = ~std::uint64_t{0});
  ~FaultyReads();
  FaultyReads(const FaultyReads&) = delete;

  // How many went wrong so far.
  static unsigned count();
};

}  // namespace isobrick::test
