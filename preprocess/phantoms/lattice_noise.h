// Band-limited noise from a hashed lattice: deterministic, the same at every resolution.
#pragma once

#include <cstdint>
#include <vector>

namespace isobrick {

// A row of 3-D value noise: random values in [-1, 1] on a cubic lattice of `frequency` cells per
// unit length, interpolated with smoothsteps. The share of y and z is worked out once per row,
// so a sample costs one interpolation. at() depends on (seed, position) alone, not on the row.
class NoiseRow {
 public:
  // Covers x in [x_first, x_last], in the same units as y and z.
  NoiseRow(std::uint32_t seed, float frequency, float x_first, float x_last, float y, float z)
      : frequency_(frequency), first_cell_(cellOf(x_first * frequency)) {
    const std::int32_t last_cell = cellOf(x_last * frequency);
    const std::int32_t j = cellOf(y * frequency), k = cellOf(z * frequency);
    const float v = smoothstep(y * frequency - static_cast<float>(j));
    const float w = smoothstep(z * frequency - static_cast<float>(k));
    for (std::int32_t i = first_cell_; i <= last_cell + 1; ++i) {
      const float a = mix(corner(seed, i, j, k), corner(seed, i, j + 1, k), v);
      const float b = mix(corner(seed, i, j, k + 1), corner(seed, i, j + 1, k + 1), v);
      columns_.push_back(mix(a, b, w));
    }
  }

  float at(float x) const {
    const float scaled = x * frequency_;
    const std::int32_t i = cellOf(scaled);
    const float* column = columns_.data() + (i - first_cell_);
    return mix(column[0], column[1], smoothstep(scaled - static_cast<float>(i)));
  }

 private:
  // floor(), without the library call that plain x86-64 needs for it.
  static std::int32_t cellOf(float scaled) {
    const auto truncated = static_cast<std::int32_t>(scaled);
    return truncated - (scaled < static_cast<float>(truncated) ? 1 : 0);
  }
  static float smoothstep(float t) { return t * t * (3 - 2 * t); }
  static float mix(float a, float b, float t) { return a + (b - a) * t; }

  // Integer hash (after the finalizer of MurmurHash3) of a lattice point, as a value in [-1, 1].
  static float corner(std::uint32_t seed, std::int32_t i, std::int32_t j, std::int32_t k) {
    std::uint32_t h = seed + static_cast<std::uint32_t>(i) * 0x9e3779b1u +
                      static_cast<std::uint32_t>(j) * 0x85ebca77u +
                      static_cast<std::uint32_t>(k) * 0xc2b2ae3du;
    h ^= h >> 16;
    h *= 0x85ebca6bu;
    h ^= h >> 13;
    h *= 0xc2b2ae35u;
    h ^= h >> 16;
    return static_cast<float>(static_cast<std::int32_t>(h)) * 0x1p-31f;
  }

  float frequency_;
  std::int32_t first_cell_;
  std::vector<float> columns_;
};

}  // namespace isobrick
