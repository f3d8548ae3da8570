// TIFF slices for tests.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace isobrick::test {

// A minimal little-endian TIFF: grey, or of colours of three values, each of `bits`.
inline std::string tiffBytes(std::uint32_t width, std::uint32_t height, std::uint16_t bits,
                             const std::string& pixels, std::uint32_t values = 1) {
  std::string bytes = "II*";
  const auto add16 = [&](std::uint32_t v) {
    bytes += static_cast<char>(v & 255);
    bytes += static_cast<char>(v >> 8 & 255);
  };
  const auto add32 = [&](std::uint32_t v) {
    add16(v & 0xffff);
    add16(v >> 16);
  };
  bytes += '\0';
  add32(8);
  const std::vector<std::array<std::uint32_t, 2>> entries = {
      {256, width},
      {257, height},
      {258, bits},
      {259, 1},
      {262, values == 3 ? 2u : 1u},
      {273, 8 + 2 + 9 * 12 + 4},
      {277, values},
      {278, height},
      {279, width * height * values * bits / 8}};
  add16(static_cast<std::uint32_t>(entries.size()));
  for (const auto& [tag, value] : entries) {
    add16(tag);
    add16(4);  // LONG
    add32(1);
    add32(value);
  }
  add32(0);
  return bytes + pixels;
}

}  // namespace isobrick::test
