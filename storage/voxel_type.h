// The five voxel types that a pyramid can hold, and dispatch from the run-time tag to the C++ type.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string_view>

namespace isobrick {

// The numbers are part of the file format (docs/FORMAT.md); do not renumber.
enum class VoxelType : std::uint32_t {
  kUint8 = 0,
  kInt8 = 1,
  kUint16 = 2,
  kInt16 = 3,
  kFloat32 = 4
};
inline constexpr std::uint32_t kVoxelTypeCount = 5;

// Size of one voxel in bytes.
constexpr std::size_t voxelBytes(VoxelType type) {
  constexpr std::size_t kBytes[kVoxelTypeCount] = {1, 1, 2, 2, 4};
  return kBytes[static_cast<std::uint32_t>(type)];
}

// "uint8", "int8", "uint16", "int16" or "float32".
constexpr std::string_view voxelTypeName(VoxelType type) {
  constexpr std::string_view kNames[kVoxelTypeCount] = {"uint8", "int8", "uint16", "int16",
                                                        "float32"};
  return kNames[static_cast<std::uint32_t>(type)];
}

template <typename T>
struct VoxelTag {
  using Type = T;
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
  }
  throw std::logic_error("voxel type out of range");
}

// Instantiates a template for every voxel type: M(T) is a macro with the explicit instantiation.
#define ISOBRICK_FOR_EACH_VOXEL_TYPE(M) \
  M(std::uint8_t)                       \
  M(std::int8_t)                        \
  M(std::uint16_t)                      \
  M(std::int16_t)                       \
  M(float)

}  // namespace isobrick
