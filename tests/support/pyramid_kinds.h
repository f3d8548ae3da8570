// A small pyramid of every kind, for tests that damage them.
#pragma once

#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/source_bricks.h"
#include "tests/support/array_source.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {

struct PyramidKind {
  const char* name;
  VoxelType type = VoxelType::kUint8;
  format::Codec codec = format::Codec::kLz4;
  bool has_curvature = true;
  bool has_missing = false;
  ValueTransform values = {};
  format::Filter filter = format::Filter::kAverage;
  std::int64_t super_cells = 0;
  bool is_index = false;

  BuildOptions options() const {
    BuildOptions options;
    options.brick_cells = 4;
    options.tile_cells = 2;
    options.codec = codec;
    options.with_curvature = has_curvature;
    options.mask_nan = has_missing;
    options.filter = filter;
    options.super_cells = super_cells;
    if (is_index) options.source_record = "{}";
    return options;
  }
};
inline void PrintTo(const PyramidKind& kind, std::ostream* out) { *out << kind.name; }

inline constexpr PyramidKind kPyramidKinds[] = {
    {.name = "Uint8Stored", .codec = format::Codec::kStored},
    {.name = "Uint8Lz4WithoutCurvature", .has_curvature = false},
    {.name = "Int8Zstd", .type = VoxelType::kInt8, .codec = format::Codec::kZstd},
    {.name = "Uint16Lz4", .type = VoxelType::kUint16},
    {.name = "Int16ZstdSubsampled",
     .type = VoxelType::kInt16,
     .codec = format::Codec::kZstd,
     .filter = format::Filter::kSubsample},
    {.name = "Float32Lz4", .type = VoxelType::kFloat32},
    {.name = "Float32ZstdMissing",
     .type = VoxelType::kFloat32,
     .codec = format::Codec::kZstd,
     .has_missing = true},
    {.name = "Uint16StoredTransformed",
     .type = VoxelType::kUint16,
     .codec = format::Codec::kStored,
     .values = {0.5, -1000}},
    {.name = "Divided", .type = VoxelType::kInt16, .super_cells = 8},
    {.name = "Index", .type = VoxelType::kUint16, .is_index = true},
};

// A ball of 60 to 0 with noise beside it, and 7 from x = 9 on.
class KindSource : public CheckedSource {
 public:
  explicit KindSource(const PyramidKind& kind)
      : CheckedSource(Index3(12, 7, 6), kind.type), has_missing_(kind.has_missing) {
    editInfo().source = "kind";
    editInfo().values = kind.values;
  }
  // Of voxel `at` with this added.
  int seed = 0;

  template <typename T>
  T valueAt(const Index3& at) const {
    if (at.x >= 9) return T{7};
    if (has_missing_ && at == Index3(2, 3, 4)) return std::numeric_limits<T>::quiet_NaN();
    const std::int64_t noise = (at.x * 7919 + at.y * 104729 + at.z * 1299709 + seed) % 13;
    const std::int64_t d =
        (at.x - 4) * (at.x - 4) + (at.y - 3) * (at.y - 3) + (at.z - 3) * (at.z - 3);
    return static_cast<T>(std::max<std::int64_t>(60 - 3 * d, 0) + noise);
  }
  void fill(const IndexBox& box, void* out) const {
    visitVoxelType(info().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      T* to = static_cast<T*>(out);
      forEachIndex(box, [&](const Index3& at) { *to++ = valueAt<T>(at); });
    });
  }

 private:
  void fillRows(std::int64_t first, std::int64_t count, void* out) override {
    forEachSliceOfRows(info(), first, count, out,
                       [&](std::int64_t z, std::int64_t y, std::int64_t rows, std::byte* to) {
                         fill({Index3(0, y, z), Index3(info().voxels.x, rows, 1)}, to);
                       });
  }

  const bool has_missing_;
};

// Level 0 of the index.
class KindBricks final : public SourceBricks {
 public:
  KindBricks(const PyramidKind& kind, const BrickLayout& layout) : source_(kind), layout_(layout) {}
  const std::string& path() const override { return source_.info().source; }
  std::uint64_t heldBytes() const override { return 0; }
  void copySamples(const Index3& brick, std::byte* out) const override {
    source_.fill(layout_.brickSampleBox(0, brick), out);
  }
  void announce(std::span<const Index3>) const override {}

 private:
  const KindSource source_;
  const BrickLayout layout_;
};

// Builds it in `folder`, and returns its path. For an index this process has its source then.
inline std::string buildKind(const PyramidKind& kind, const TemporaryFolder& folder) {
  const auto source = [&] { return std::make_unique<KindSource>(kind); };
  if (kind.is_index)
    setSourceOpener([kind](const SourceRequest& request) {
      return std::make_shared<KindBricks>(kind, request.spec.layout());
    });
  const std::string path = folder.file(kind.super_cells > 0 ? "kind.isbs" : "kind.isb");
  if (kind.super_cells == 0) {
    buildPyramid(*source(), path, kind.options());
    return path;
  }
  std::filesystem::create_directory(path);
  const std::size_t files = superBrickFiles(source()->info(), kind.options()).size();
  for (std::size_t number = 0; number < files; ++number)
    buildSuperBrick(*source(), path, number, kind.options());
  joinPyramid(path, {});
  return path;
}

// Of a pyramid, in the order of their names.
inline std::vector<std::string> filesOfPyramid(const std::string& path) {
  if (!std::filesystem::is_directory(path)) return {path};
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(path))
    files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace isobrick::test
