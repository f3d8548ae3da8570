// Numbers of either byte order in the bytes of a file.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace isobrick {

// The number of type T that is stored at `from`.
template <typename T>
T loadNumber(const void* from, bool big_endian) {
  std::array<std::byte, sizeof(T)> bytes;
  std::memcpy(bytes.data(), from, sizeof(T));
  if (big_endian != (std::endian::native == std::endian::big))
    std::reverse(bytes.begin(), bytes.end());
  return std::bit_cast<T>(bytes);
}

// An unsigned number of 1 to 8 bytes.
inline std::uint64_t loadUnsigned(const void* from, std::size_t bytes, bool big_endian) {
  std::array<std::byte, 8> whole{};
  std::memcpy(whole.data() + (big_endian ? 8 - bytes : 0), from, bytes);
  return loadNumber<std::uint64_t>(whole.data(), big_endian);
}

}  // namespace isobrick
