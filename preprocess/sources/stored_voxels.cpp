#include "isobrick/preprocess/sources/stored_voxels.h"

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

void zeroNotFinite(float* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i)
    if (!std::isfinite(values[i])) values[i] = 0;
}

template <typename T>
void convert(const StoredVoxels& stored, const std::byte* in, std::size_t count, float* out) {
  const StoredVoxels::Map map = stored.map.value_or(StoredVoxels::Map{});
  const bool maps = stored.map.has_value();
  for (std::size_t i = 0; i < count; ++i) {
    T value;
    std::memcpy(&value, in + i * sizeof(T), sizeof(T));
    if constexpr (std::is_floating_point_v<T>)
      if (stored.not_finite_is_zero && !std::isfinite(value)) value = 0;
    if (!maps) {
      out[i] = static_cast<float>(value);
    } else {
      double number;
      if constexpr (std::is_same_v<T, double>)
        number = value;
      else
        number = static_cast<double>(static_cast<float>(value));
      out[i] = static_cast<float>(number * map.slope + map.intercept);
    }
  }
}

}  // namespace

std::size_t storedBytes(StoredType type) {
  switch (type) {
    case StoredType::kUint8:
    case StoredType::kInt8:
      return 1;
    case StoredType::kUint16:
    case StoredType::kInt16:
      return 2;
    case StoredType::kUint32:
    case StoredType::kInt32:
    case StoredType::kFloat32:
      return 4;
    case StoredType::kUint64:
    case StoredType::kInt64:
    case StoredType::kFloat64:
      return 8;
  }
  return 0;
}

VoxelType StoredVoxels::delivered() const {
  if (map) return VoxelType::kFloat32;
  switch (type) {
    case StoredType::kUint8:
      return VoxelType::kUint8;
    case StoredType::kInt8:
      return VoxelType::kInt8;
    case StoredType::kUint16:
      return VoxelType::kUint16;
    case StoredType::kInt16:
      return VoxelType::kInt16;
    default:
      return VoxelType::kFloat32;
  }
}

bool StoredVoxels::keepsType() const {
  return !map && (delivered() != VoxelType::kFloat32 || type == StoredType::kFloat32);
}

bool StoredVoxels::isVerbatim() const {
  // The byte order of the machine is little-endian (storage/format.h).
  return keepsType() && (!big_endian || bytes() == 1) &&
         !(not_finite_is_zero && type == StoredType::kFloat32);
}

void StoredVoxels::decodeInPlace(void* data, std::size_t count) const {
  if (big_endian) swapElements(data, count, bytes());
  if (not_finite_is_zero && type == StoredType::kFloat32)
    zeroNotFinite(static_cast<float*>(data), count);
}

void StoredVoxels::decode(std::byte* stored, std::size_t count, float* out) const {
  if (big_endian) swapElements(stored, count, bytes());
  switch (type) {
    case StoredType::kUint8:
      return convert<std::uint8_t>(*this, stored, count, out);
    case StoredType::kInt8:
      return convert<std::int8_t>(*this, stored, count, out);
    case StoredType::kUint16:
      return convert<std::uint16_t>(*this, stored, count, out);
    case StoredType::kInt16:
      return convert<std::int16_t>(*this, stored, count, out);
    case StoredType::kUint32:
      return convert<std::uint32_t>(*this, stored, count, out);
    case StoredType::kInt32:
      return convert<std::int32_t>(*this, stored, count, out);
    case StoredType::kUint64:
      return convert<std::uint64_t>(*this, stored, count, out);
    case StoredType::kInt64:
      return convert<std::int64_t>(*this, stored, count, out);
    case StoredType::kFloat32:
      return convert<float>(*this, stored, count, out);
    case StoredType::kFloat64:
      return convert<double>(*this, stored, count, out);
  }
}

}  // namespace isobrick
