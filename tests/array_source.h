// A volume in memory as a source for the builder.
#pragma once

#include <cstring>
#include <utility>
#include <vector>

#include "preprocess/volume_source.h"

namespace isobrick::test {

template <typename T>
constexpr VoxelType voxelTypeOf() {
  if constexpr (std::is_same_v<T, std::uint8_t>) return VoxelType::kUint8;
  if constexpr (std::is_same_v<T, std::int8_t>) return VoxelType::kInt8;
  if constexpr (std::is_same_v<T, std::uint16_t>) return VoxelType::kUint16;
  if constexpr (std::is_same_v<T, std::int16_t>) return VoxelType::kInt16;
  if constexpr (std::is_same_v<T, float>) return VoxelType::kFloat32;
}

template <typename T>
class ArraySource : public VolumeSource {
 public:
  ArraySource(const Index3& voxels, std::vector<T> values, const GridGeometry& geometry = {})
      : values_(std::move(values)) {
    info_.voxels = voxels;
    info_.voxel_type = voxelTypeOf<T>();
    info_.geometry = geometry;
    info_.source = "array";
    info_.format = "memory";
  }
  const VolumeInfo& info() const override { return info_; }
  void readSlices(std::int64_t first, std::int64_t count, void* out) override {
    const std::int64_t slice = info_.voxels.x * info_.voxels.y;
    std::memcpy(out, values_.data() + first * slice,
                static_cast<std::size_t>(count * slice) * sizeof(T));
  }
  const std::vector<T>& values() const { return values_; }

 private:
  VolumeInfo info_;
  std::vector<T> values_;
};

}  // namespace isobrick::test
