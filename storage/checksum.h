// The checksum of the file format.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

namespace isobrick {

// XXH3-64.
std::uint64_t checksum64(const void* data, std::size_t bytes, std::uint64_t seed = 0);

// The same for bytes that come one run after the other.
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
