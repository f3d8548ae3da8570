// The five voxel types that a pyramid can hold, those of other volumes, and dispatch from the
// run-time tag to the C++ type.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <type_traits>
#include <utility>

namespace isobrick {

// The numbers are part of the file format (docs/FORMAT.md); do not renumber.
enum class VoxelType : std::uint32_t {
  kUint8 = 0,
  kInt8 = 1,
  kUint16 = 2,
  kInt16 = 3,
  kFloat32 = 4,
  // Of volumes on their way into a pyramid and out of it: no pyramid stores these.
  kUint64 = 5,
  kInt64 = 6,
  kUint32 = 7,
  kInt32 = 8,
  kFloat64 = 9
};

// Name and size of each, in the order of the numbers. Other names belong to one format each and
// stay with its reader or writer.
struct VoxelTypeInfo {
  std::string_view name;        // as it is printed
  std::string_view short_name;  // as the command takes it
  std::size_t bytes;            // of one voxel
};
// By the number of the type.
inline constexpr VoxelTypeInfo kVoxelTypes[] = {
    {"uint8", "u8", 1},    {"int8", "i8", 1},    {"uint16", "u16", 2}, {"int16", "i16", 2},
    {"float32", "f32", 4}, {"uint64", "u64", 8}, {"int64", "i64", 8},  {"uint32", "u32", 4},
    {"int32", "i32", 4},   {"float64", "f64", 8}};
// Number of voxel types that a pyramid can hold: the first ones.
inline constexpr std::uint32_t kVoxelTypeCount = 5;

// True for a type that a pyramid can hold.
constexpr bool isStorable(VoxelType type) {
  return static_cast<std::uint32_t>(type) < kVoxelTypeCount;
}

// Bytes of a voxel. `type`: one of these; code that reads it from a file checks that.
constexpr std::size_t voxelBytes(VoxelType type) {
  return kVoxelTypes[static_cast<std::uint32_t>(type)].bytes;
}
// "uint8", ...
constexpr std::string_view voxelTypeName(VoxelType type) {
  return kVoxelTypes[static_cast<std::uint32_t>(type)].name;
}

// The type of a name, long or short, that a pyramid can hold.
constexpr std::optional<VoxelType> voxelTypeNamed(std::string_view name) {
  for (std::uint32_t type = 0; type < kVoxelTypeCount; ++type)
    if (name == kVoxelTypes[type].name || name == kVoxelTypes[type].short_name)
      return static_cast<VoxelType>(type);
  return std::nullopt;
}

// A C++ type as a value.
template <typename T>
struct VoxelTag {
  using Type = T;  // the type
};

// Calls `f(VoxelTag<T>{})` with the C++ type that `type` stands for and returns its result:
//   visitVoxelType(type, [&](auto tag) { using T = typename decltype(tag)::Type; ... });
template <typename F>
decltype(auto) visitVoxelType(VoxelType type, F&& f) {
  switch (type) {
    case VoxelType::kUint8:
      return f(VoxelTag<std::uint8_t>{});
    case VoxelType::kInt8:
      return f(VoxelTag<std::int8_t>{});
    case VoxelType::kUint16:
      return f(VoxelTag<std::uint16_t>{});
    case VoxelType::kInt16:
      return f(VoxelTag<std::int16_t>{});
    case VoxelType::kFloat32:
      return f(VoxelTag<float>{});
    default:
      throw std::logic_error("voxel type out of range");
  }
}

// The same for all types that volumes may have.
template <typename F>
decltype(auto) visitNumberType(VoxelType type, F&& f) {
  switch (type) {
    case VoxelType::kUint64:
      return f(VoxelTag<std::uint64_t>{});
    case VoxelType::kInt64:
      return f(VoxelTag<std::int64_t>{});
    case VoxelType::kUint32:
      return f(VoxelTag<std::uint32_t>{});
    case VoxelType::kInt32:
      return f(VoxelTag<std::int32_t>{});
    case VoxelType::kFloat64:
      return f(VoxelTag<double>{});
    default:
      return visitVoxelType(type, std::forward<F>(f));
  }
}

// The voxel type of a C++ type, which is one of these.
template <typename T>
constexpr VoxelType voxelTypeOf() {
  if constexpr (std::is_same_v<T, std::uint64_t>) return VoxelType::kUint64;
  if constexpr (std::is_same_v<T, std::int64_t>) return VoxelType::kInt64;
  if constexpr (std::is_same_v<T, std::uint32_t>) return VoxelType::kUint32;
  if constexpr (std::is_same_v<T, std::int32_t>) return VoxelType::kInt32;
  if constexpr (std::is_same_v<T, double>) return VoxelType::kFloat64;
  if constexpr (std::is_same_v<T, std::uint8_t>) return VoxelType::kUint8;
  if constexpr (std::is_same_v<T, std::int8_t>) return VoxelType::kInt8;
  if constexpr (std::is_same_v<T, std::uint16_t>) return VoxelType::kUint16;
  if constexpr (std::is_same_v<T, std::int16_t>) return VoxelType::kInt16;
  if constexpr (std::is_same_v<T, float>) return VoxelType::kFloat32;
}

// Instantiates a template for every voxel type: M(T) is a macro with the explicit instantiation.
#define ISOBRICK_FOR_EACH_VOXEL_TYPE(M) \
  M(std::uint8_t)                       \
  M(std::int8_t)                        \
  M(std::uint16_t)                      \
  M(std::int16_t)                       \
  M(float)

// Numbers and types agree.
#define ISOBRICK_CHECK_BYTES(T) static_assert(voxelBytes(voxelTypeOf<T>()) == sizeof(T));
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_CHECK_BYTES)
#undef ISOBRICK_CHECK_BYTES

// Closed interval; empty until something was included. Every voxel type fits float exactly.
struct ValueRange {
  float min = std::numeric_limits<float>::infinity();   // the least value
  float max = -std::numeric_limits<float>::infinity();  // the greatest value

  bool operator==(const ValueRange&) const = default;
  // Grows to include a value.
  void include(float v) {
    min = std::min(min, v);
    max = std::max(max, v);
  }
  // Grows to include another range.
  void include(const ValueRange& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
  }
  // True if values on both sides of the isovalue occur; a value equal to it is inside.
  bool crosses(float isovalue) const { return min < isovalue && max >= isovalue; }
};

// The least voxel that is inside: v >= isovalue exactly if v >= the threshold. None if no voxel of
// the type is inside. T: a voxel type.
template <typename T>
std::optional<T> insideThreshold(float isovalue) {
  if constexpr (std::is_floating_point_v<T>) {
    return isovalue;
  } else {
    const float least = std::ceil(isovalue);
    if (least > static_cast<float>(std::numeric_limits<T>::max())) return std::nullopt;
    if (least < static_cast<float>(std::numeric_limits<T>::lowest()))
      return std::numeric_limits<T>::lowest();
    return static_cast<T>(least);
  }
}

}  // namespace isobrick
