#include "isobrick/preprocess/sources/stored_voxels.h"

#include <bit>
#include <cmath>
#include <cstring>

namespace isobrick {
namespace {

// Exchanges the halves of each of `count` numbers in place.
template <typename Bits>
void exchangeHalves(unsigned char* data, std::size_t count) {
  constexpr int kHalf = 4 * static_cast<int>(sizeof(Bits));
  for (std::size_t i = 0; i < count; ++i) {
    Bits bits;
    std::memcpy(&bits, data + i * sizeof(Bits), sizeof(Bits));
    bits = static_cast<Bits>(bits << kHalf | bits >> kHalf);
    std::memcpy(data + i * sizeof(Bits), &bits, sizeof(Bits));
  }
}

// Reverses the bytes of `count` elements in place. Halves of halves, because each of the loops
// becomes vector instructions that every x86-64 has; a loop over __builtin_bswap32 does not.
void swapElements(void* data, std::size_t count, std::size_t element_bytes) {
  constexpr std::size_t kBlockBytes = 8 << 10;  // stays in the nearest cache between the loops
  auto* const all = static_cast<unsigned char*>(data);
  const std::size_t bytes = element_bytes == 1 ? 0 : count * element_bytes;
  for (std::size_t at = 0; at < bytes; at += kBlockBytes) {
    const std::size_t block = std::min(kBlockBytes, bytes - at);
    exchangeHalves<std::uint16_t>(all + at, block / 2);
    if (element_bytes >= 4) exchangeHalves<std::uint32_t>(all + at, block / 4);
    if (element_bytes == 8) exchangeHalves<std::uint64_t>(all + at, block / 8);
  }
}

float plainNumber(Half half) {
  const std::uint32_t sign = (half.bits & 0x8000u) << 16, exponent = half.bits >> 10 & 31u,
                      fraction = half.bits & 0x3ffu;
  if (exponent == 0) {
    const float value = std::ldexp(static_cast<float>(fraction), -24);
    return sign != 0 ? -value : value;
  }
  return std::bit_cast<float>(sign | (exponent == 31 ? 255u : exponent + 112u) << 23 |
                              fraction << 13);
}
template <typename T>
T plainNumber(T number) {
  return number;
}

// The number of type T at `from`.
template <typename T>
auto numberAt(const std::byte* from) {
  T value;
  std::memcpy(&value, from, sizeof(T));
  return plainNumber(value);
}

template <typename T, typename Out>
void mapNumbers(const StoredVoxels::Map& map, const std::byte* in, std::size_t count, Out* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto number = static_cast<double>(numberAt<T>(in + i * sizeof(T)));
    out[i] = static_cast<Out>(number * map.slope + map.intercept);
  }
}

template <typename T>
void findMagnitudes(const std::byte* in, std::size_t count, std::size_t components, float* out) {
  for (std::size_t i = 0; i < count; ++i) {
    double squares = 0;
    for (std::size_t c = 0; c < components; ++c) {
      const auto value = static_cast<double>(numberAt<T>(in + (i * components + c) * sizeof(T)));
      squares += value * value;
    }
    out[i] = static_cast<float>(std::sqrt(squares));
  }
}

}  // namespace

VoxelType StoredVoxels::delivered() const {
  if (magnitude) return VoxelType::kFloat32;
  if (map) {
    // Single precision holds 24 bits, also of what follows a large intercept.
    constexpr double kMostSteps = 0x1p24;
    const bool fits = bytes() / components <= 2 || type == StoredType::kFloat32;
    return fits && std::abs(map->intercept) <= kMostSteps * std::abs(map->slope)
               ? VoxelType::kFloat32
               : VoxelType::kFloat64;
  }
  for (std::uint32_t i = 0; i < std::size(kVoxelTypes); ++i)
    if (kVoxelTypes[i].name == infoOf(type).name) return static_cast<VoxelType>(i);
  return VoxelType::kFloat32;
}

bool StoredVoxels::keepsType() const {
  return components == 1 && !map && type != StoredType::kFloat16;
}

bool StoredVoxels::isVerbatim() const {
  // The byte order of the machine is little-endian (storage/format.h).
  return keepsType() && (!big_endian || bytes() == 1);
}

void StoredVoxels::decodeInPlace(void* data, std::size_t count) const {
  if (big_endian) swapElements(data, count, bytes());
}

void StoredVoxels::decode(std::byte* stored, std::size_t count, void* out) const {
  if (big_endian) swapElements(stored, count, bytes());
  const Map to = map.value_or(Map{1, -0.0});  // 0 would lose the sign of -0
  visitStoredType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    if (delivered() == VoxelType::kFloat64)
      mapNumbers<T>(to, stored, count, static_cast<double*>(out));
    else
      mapNumbers<T>(to, stored, count, static_cast<float*>(out));
  });
}

void StoredVoxels::decodeComponents(std::byte* stored, std::size_t count, void* out) const {
  const std::size_t number_bytes = storedBytes(type);
  if (magnitude) {
    if (big_endian) swapElements(stored, count * components, number_bytes);
    visitStoredType(type, [&](auto tag) {
      findMagnitudes<typename decltype(tag)::Type>(stored, count, components,
                                                   static_cast<float*>(out));
    });
    return;
  }
  for (std::size_t i = 0; i < count; ++i)
    std::memmove(stored + i * number_bytes, stored + (i * components + component) * number_bytes,
                 number_bytes);
  StoredVoxels one = *this;
  one.components = 1;
  if (one.keepsType()) {
    one.decodeInPlace(stored, count);
    std::memcpy(out, stored, count * number_bytes);
  } else {
    one.decode(stored, count, out);
  }
}

}  // namespace isobrick
