// How the voxels of a file are stored, and what becomes of them. Private to preprocess/sources/.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "isobrick/storage/voxel_type.h"

namespace isobrick {

enum class StoredType {
  kUint8,
  kInt8,
  kUint16,
  kInt16,
  kUint32,
  kInt32,
  kUint64,
  kInt64,
  kFloat32,
  kFloat64
};

std::size_t storedBytes(StoredType type);

// Numbers in a file. Those of the five voxel types are delivered as they are; others, and all that
// are mapped, become float32.
struct StoredVoxels {
  StoredType type = StoredType::kUint8;
  bool big_endian = false;
  // value = stored * slope + intercept, in double, of integers that became float32 first, as ITK
  // does it.
  struct Map {
    double slope = 1, intercept = 0;
  };
  std::optional<Map> map;
  // Floating-point numbers that are not finite count as 0, before the map: what the NIfTI library
  // does.
  bool not_finite_is_zero = false;

  std::size_t bytes() const { return storedBytes(type); }
  VoxelType delivered() const;
  // Whether delivered numbers have the type of the stored ones.
  bool keepsType() const;
  // Whether delivered bytes are the stored ones.
  bool isVerbatim() const;

  // Where keepsType(): makes `count` stored numbers at `data` delivered ones.
  void decodeInPlace(void* data, std::size_t count) const;
  // Otherwise: `stored`, aligned for its type, is overwritten on the way.
  void decode(std::byte* stored, std::size_t count, float* out) const;
};

// Delivers `count` voxels to `out`, aligned for its type. read(bytes, n) must fetch the next n
// stored bytes; it is asked for pieces that stay in the processor's cache wherever they are worked
// on. Holds kDecodeBufferBytes on the stack.
inline constexpr std::size_t kDecodeBufferBytes = std::size_t{32} << 10;
template <typename Read>
void decodeVoxels(const StoredVoxels& stored, std::size_t count, void* out, Read&& read) {
  auto* to = static_cast<std::byte*>(out);
  if (stored.keepsType()) {
    constexpr std::size_t kPieceBytes = std::size_t{256} << 10;
    const std::size_t most = stored.isVerbatim() ? count : kPieceBytes / stored.bytes();
    while (count > 0) {
      const std::size_t voxels = std::min(count, most);
      read(to, voxels * stored.bytes());
      stored.decodeInPlace(to, voxels);
      to += voxels * stored.bytes();
      count -= voxels;
    }
  } else {
    alignas(8) std::array<std::byte, kDecodeBufferBytes> buffer;
    while (count > 0) {
      const std::size_t voxels = std::min(count, kDecodeBufferBytes / stored.bytes());
      read(buffer.data(), voxels * stored.bytes());
      stored.decode(buffer.data(), voxels, reinterpret_cast<float*>(to));
      to += voxels * sizeof(float);
      count -= voxels;
    }
  }
}

}  // namespace isobrick
