// Plain values one after the other in memory.
#pragma once

#include <cstddef>
#include <cstring>

namespace isobrick {

// Writes the bytes of values, as this machine has them, into memory that is large enough.
class BytePointer {
 public:
  explicit BytePointer(std::byte* at) : at_(at) {}
  template <typename... Values>
  void put(Values... values) {
    (putOne(values), ...);
  }

 private:
  template <typename V>
  void putOne(V value) {
    std::memcpy(at_, &value, sizeof value);
    at_ += sizeof value;
  }
  std::byte* at_;
};

}  // namespace isobrick
