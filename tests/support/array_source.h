// Volumes in memory as sources for the builder.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick::test {

// The base of the tests' sources: their info(), and a check that the builder keeps the contract of
// VolumeSource::readRows (ascending rows, none twice, none past the last). So a source serves one
// build.
class CheckedSource : public VolumeSource {
 public:
  const VolumeInfo& info() const override { return info_; }
  VolumeInfo& editInfo() { return info_; }  // not during a build
  std::string identity() const override { return info_.source; }
  void readRows(std::int64_t first, std::int64_t count, void* out) final {
    EXPECT_GE(first, next_row_);
    EXPECT_GT(count, 0);
    EXPECT_LE(first + count, info_.voxels.y * info_.voxels.z);
    next_row_ = first + count;
    fillRows(first, count, out);
  }

 protected:
  CheckedSource(const Index3& voxels, VoxelType type) {
    info_.voxels = voxels;
    info_.voxel_type = type;
    info_.source = "memory";
    info_.format = "test";
  }

 private:
  // As VolumeSource::readRows.
  virtual void fillRows(std::int64_t first, std::int64_t count, void* out) = 0;

  VolumeInfo info_;
  std::int64_t next_row_ = 0;
};

// Holds all voxels, x fastest.
template <typename T>
class ArraySource : public CheckedSource {
 public:
  ArraySource(const Index3& voxels, std::vector<T> values, const GridGeometry& geometry = {})
      : CheckedSource(voxels, voxelTypeOf<T>()), values_(std::move(values)) {
    editInfo().geometry = geometry;
  }
  const std::vector<T>& values() const { return values_; }

 private:
  void fillRows(std::int64_t first, std::int64_t count, void* out) override {
    const std::int64_t row = info().voxels.x;
    std::memcpy(out, values_.data() + first * row,
                static_cast<std::size_t>(count * row) * sizeof(T));
  }

  std::vector<T> values_;
};

// field(Index3) at every voxel, x fastest: what an ArraySource of these dimensions takes.
template <typename T, typename F>
std::vector<T> arrayOfField(const Index3& dims, F&& field) {
  std::vector<T> values;
  values.reserve(static_cast<std::size_t>(elementCount(dims)));
  for (std::int64_t z = 0; z < dims.z; ++z)
    for (std::int64_t y = 0; y < dims.y; ++y)
      for (std::int64_t x = 0; x < dims.x; ++x)
        values.push_back(static_cast<T>(field(Index3(x, y, z))));
  return values;
}

}  // namespace isobrick::test
