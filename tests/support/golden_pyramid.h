// The small pyramids that are checked in under tests/golden: how they are made, and what is in them
// as plain text. Writer and reader cannot change together without changing one of these files.
#pragma once

#include <string>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/plain_reader.h"

namespace isobrick::test {

struct GoldenPyramid {
  std::string name;  // of the files name.isb and name.txt
  VoxelType voxel_type{};
  Index3 voxels{0};
  BuildOptions options;
  ValueTransform values;  // else the file is of version 3
};

// Every voxel type with every codec; odd sizes, both filters, with curvature and without; of
// version 3, and two with transforms of version 4.
std::vector<GoldenPyramid> goldenPyramids();

// Writes it as the library does now. Its voxels are made with whole numbers alone, so that they are
// the same everywhere: constant for x <= 10, then ever steeper.
void buildGoldenPyramid(const GoldenPyramid& golden, const std::string& path);

// Header, levels and bricks; of a brick its parts in the file, its ranges and the hash of its
// unpacked elements, and all values where they are few. Without the provenance, which says how the
// file was made.
std::string dumpOf(const PlainPyramid& pyramid);
// The same read by the library, which does not tell how the parts lie in the file: without the
// lines that begin with "  part".
std::string dumpOf(const Pyramid& pyramid);
std::string withoutParts(const std::string& dump);

}  // namespace isobrick::test
