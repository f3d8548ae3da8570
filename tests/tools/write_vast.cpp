// Writes the pyramid of SIZE^3 voxels of uint8 that are all the same, brick by brick, without the
// voxels, which nobody could hold:
//
//   write_vast SIZE FILE
//
// For tests of what costs in proportion to a file's bricks: 19 million of them, 1.4 GB of table, at
// 16384^3.
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "isobrick/storage/pyramid_writer.h"

namespace isobrick::test {
namespace {

void writeVast(std::int64_t size, const std::string& path) {
  PyramidSpec spec;
  spec.voxels = Index3(size);
  spec.has_curvature = false;
  const BrickLayout layout = spec.layout();
  PyramidWriter writer(path, spec, "vast", false, nullptr);
  std::uint64_t bricks = 0;
  EncodedBrick brick;
  for (EncodedPart* part : {&brick.samples, &brick.ranges}) part->codec = format::Codec::kConstant;
  for (int level = 0; level < layout.lattice().levels(); ++level)
    for (std::int64_t left = elementCount(layout.bricks(level)); left > 0; --left, ++bricks)
      writer.write(brick);
  const ValueRange range{0, 0};
  const std::vector<ValueRange> ranges(bricks, range);
  VoxelHistogram histogram(spec.voxel_type, range);
  histogram.counts()[0] = static_cast<std::uint64_t>(elementCount(spec.voxels));
  writer.finish({range, ranges, histogram, 0, "{}", {}}, format::Codec::kStored);
  std::printf("%llu bricks\n", static_cast<unsigned long long>(bricks));
}

}  // namespace
}  // namespace isobrick::test

int main(int argc, char** argv) try {
  if (argc != 3) {
    std::fprintf(stderr, "usage: write_vast SIZE FILE\n");
    return 2;
  }
  isobrick::test::writeVast(std::stol(argv[1]), argv[2]);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "write_vast: %s\n", error.what());
  return 1;
}
