// How the voxels of a file are stored, which of several values is taken, and how they are
// delivered. Private to preprocess/sources/.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"
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
  kFloat16,
  kFloat32,
  kFloat64
};

// Name and size of each, in their order. Other names belong to one format each and stay with
// its reader.
struct StoredTypeInfo {
  std::string_view name, short_name;  // as of a VoxelType
  std::string_view c_name;            // its name in C; empty if that depends on the machine
  std::size_t bytes;                  // of one number
};
inline constexpr StoredTypeInfo kStoredTypes[] = {
    {"uint8", "u8", "uchar", 1},    {"int8", "i8", "char", 1},      {"uint16", "u16", "ushort", 2},
    {"int16", "i16", "short", 2},   {"uint32", "u32", "uint", 4},   {"int32", "i32", "int", 4},
    {"uint64", "u64", "", 8},       {"int64", "i64", "", 8},        {"float16", "f16", "half", 2},
    {"float32", "f32", "float", 4}, {"float64", "f64", "double", 8}};

constexpr const StoredTypeInfo& infoOf(StoredType type) {
  return kStoredTypes[static_cast<std::size_t>(type)];
}
constexpr std::size_t storedBytes(StoredType type) { return infoOf(type).bytes; }
// The type of unsigned ('u') or signed ('i') integers or floats ('f') of so many bytes, if it is
// one of them.
constexpr std::optional<StoredType> storedTypeOf(char kind, std::size_t bytes) {
  for (std::size_t type = 0; type < std::size(kStoredTypes); ++type)
    if (kStoredTypes[type].name[0] == kind && kStoredTypes[type].bytes == bytes)
      return static_cast<StoredType>(type);
  return std::nullopt;
}

// The type of that long name, if it is one of them.
constexpr std::optional<StoredType> storedTypeNamed(std::string_view name) {
  for (std::size_t type = 0; type < std::size(kStoredTypes); ++type)
    if (kStoredTypes[type].name == name) return static_cast<StoredType>(type);
  return std::nullopt;
}

// A floating-point number of 16 bits.
struct Half {
  std::uint16_t bits;
};

template <typename T>
struct StoredTag {
  using Type = T;
};
// In the order of StoredType.
using StoredNumbers =
    std::tuple<std::uint8_t, std::int8_t, std::uint16_t, std::int16_t, std::uint32_t, std::int32_t,
               std::uint64_t, std::int64_t, Half, float, double>;
// Calls f(tag) with the C++ type of the stored numbers.
template <typename F>
void visitStoredType(StoredType type, F&& f) {
  [&]<std::size_t... i>(std::index_sequence<i...>) {
    ((static_cast<std::size_t>(type) == i ? f(StoredTag<std::tuple_element_t<i, StoredNumbers>>{})
                                          : void()),
     ...);
  }
  (std::make_index_sequence<std::tuple_size_v<StoredNumbers>>());
}

// Numbers in a file, delivered as they are (value_fit.h makes voxels of types that no pyramid has);
// those that are mapped become float32, or float64 if that would lose what tells them apart.
struct StoredVoxels {
  StoredType type = StoredType::kUint8;
  bool big_endian = false;
  // value = stored * slope + intercept, in double.
  struct Map {
    double slope = 1, intercept = 0;
  };
  std::optional<Map> map;
  // Numbers of a voxel, one behind the other, at most kMostComponents: one of them becomes its
  // value, or, with no map, the magnitude of all of them.
  std::size_t components = 1;
  std::size_t component = 0;
  bool magnitude = false;

  // For a voxel.
  std::size_t bytes() const { return storedBytes(type) * components; }
  // Bytes of so many voxels, or nothing if 64 bits do not hold them.
  std::optional<std::uint64_t> bytesOf(std::int64_t voxels) const {
    std::uint64_t product = 0;
    if (__builtin_mul_overflow(static_cast<std::uint64_t>(voxels), bytes(), &product))
      return std::nullopt;
    return product;
  }
  VoxelType delivered() const;
  // Whether delivered numbers have the type of the stored ones.
  bool keepsType() const;
  // Whether delivered bytes are the stored ones.
  bool isVerbatim() const;

  // If keepsType(): turns `count` stored numbers at `data` into delivered ones.
  void decodeInPlace(void* data, std::size_t count) const;
  // Otherwise, to voxels of the type delivered(): `stored`, aligned for its type, is overwritten on
  // the way.
  void decode(std::byte* stored, std::size_t count, void* out) const;
};

// A voxel fits the buffer below.
inline constexpr std::size_t kMostComponents = 1024;

// Delivers `count` voxels to `out`, aligned for its type. read(bytes, n) must fetch the next n
// stored bytes; the pieces are small, so that each stays in the processor's cache while it is
// converted. Holds kDecodeBufferBytes on the stack.
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
    return;
  }
  alignas(8) std::array<std::byte, kDecodeBufferBytes> buffer;
  const std::size_t delivered_bytes = voxelBytes(stored.delivered());
  while (count > 0) {
    const std::size_t voxels = std::min(count, kDecodeBufferBytes / stored.bytes());
    read(buffer.data(), voxels * stored.bytes());
    stored.decode(buffer.data(), voxels, to);
    to += voxels * delivered_bytes;
    count -= voxels;
  }
}

// Throws Error unless there is a choice of one of the values if voxels have several, and no choice
// if they have one.
void checkComponentChoice(const std::string& path, std::uint64_t components,
                          const OpenOptions& options);

// For volumes that never have several.
void refuseComponentChoice(const std::string& path, const OpenOptions& options);

// Applies a checked choice to the decoding in `stored` and to `info`, which otherwise describes
// voxels with one value.
void takeComponent(std::uint64_t components, const OpenOptions& options, StoredVoxels& stored,
                   VolumeInfo& info);

// The magnitude of voxels whose components are volumes of their own, one behind the other in a
// file: `info` as takeComponent() made it. They are read in order, a row of each at a time.
std::unique_ptr<VolumeSource> makeMagnitudeSource(
    VolumeInfo info, std::vector<std::unique_ptr<VolumeSource>> components);

}  // namespace isobrick
