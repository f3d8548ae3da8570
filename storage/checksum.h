// The checksum of the file format.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

namespace isobrick {

// XXH3-64.
std::uint64_t checksum64(const void* data, std::size_t bytes, std::uint64_t seed = 0);

// Whether bytes whose checksum was computed are those that a file states it of. All that is read is
// judged here, so that a build for fuzzing (FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION) takes every
// checksum for right, and its inputs reach what lies behind.
bool isChecksum(std::uint64_t computed, std::uint64_t stated);

// checksum64() for bytes that come one run after the other.
class RunningChecksum {
 public:
  RunningChecksum();
  ~RunningChecksum();
  RunningChecksum(const RunningChecksum&) = delete;
  RunningChecksum& operator=(const RunningChecksum&) = delete;

  void add(const void* data, std::size_t bytes);
  // checksum64() of all bytes so far, with seed 0.
  std::uint64_t value() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace isobrick
