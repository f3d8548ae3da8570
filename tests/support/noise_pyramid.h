// Small pyramids of noise, with every kind of part in them. Each function writes one into `folder`
// and returns its path.
#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/error.h"
#include "tests/support/array_source.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {

// Noise from 0 to 99, and 77 from `constant_from_x` on, so that all codecs occur.
class NoiseSource : public CheckedSource {
 public:
  NoiseSource(const Index3& dims, VoxelType type) : CheckedSource(dims, type) {
    editInfo().source = "noise";
  }
  std::int64_t fail_at_row = -1;
  std::int64_t constant_from_x = std::numeric_limits<std::int64_t>::max();

 private:
  void fillRows(std::int64_t first, std::int64_t count, void* out) override {
    if (first <= fail_at_row && fail_at_row < first + count) throw Error("the input ends");
    const Index3 dims = info().voxels;
    visitVoxelType(info().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      T* to = static_cast<T*>(out);
      for (std::int64_t i = 0; i < count * dims.x; ++i)
        to[i] = i % dims.x >= constant_from_x ? T{77} : static_cast<T>(random_() % 100);
    });
  }

  Random random_{11};
};

constexpr format::Codec kCodecs[] = {format::Codec::kStored, format::Codec::kLz4,
                                     format::Codec::kZstd};

inline BuildOptions smallBricks(format::Codec codec = format::Codec::kLz4) {
  BuildOptions options;
  options.brick_cells = 4;
  options.tile_cells = 2;
  options.codec = codec;
  return options;
}

// Several levels, several bricks in each, constant parts and, but for kStored, packed ones.
inline std::string buildGoodFile(const TemporaryFolder& folder, VoxelType type = VoxelType::kUint16,
                                 format::Codec codec = format::Codec::kLz4) {
  NoiseSource source(Index3(19, 9, 11), type);
  source.constant_from_x = 8;
  const std::string path = folder.file("good.isb");
  buildPyramid(source, path, smallBricks(codec));
  return path;
}

inline std::string buildTinyFile(const TemporaryFolder& folder) {
  NoiseSource source(Index3(3, 2, 2), VoxelType::kUint8);
  const std::string path = folder.file("tiny.isb");
  buildPyramid(source, path, smallBricks());
  return path;
}

// Bricks of several pages.
inline std::string buildPagedFile(const TemporaryFolder& folder,
                                  format::Codec codec = format::Codec::kStored) {
  NoiseSource source(Index3(70, 40, 40), VoxelType::kUint16);
  BuildOptions options;
  options.brick_cells = 16;
  options.codec = codec;
  const std::string path = folder.file("paged.isb");
  buildPyramid(source, path, options);
  return path;
}

}  // namespace isobrick::test
