// What `isobrick verify --repair` asks of isobrick-build, which reads volumes.
#pragma once

#include <cstdint>
#include <string>

#include "isobrick/preprocess/pyramid_repair.h"
#include "isobrick/storage/pyramid.h"
#include "tools/volume_input.h"

namespace isobrick {

struct RepairArguments {
  std::string pyramid;
  VolumeInput source;  // its path is "auto" for the one that the pyramid names, if that is there
  int threads = 1;
  std::uint64_t memory_bytes = Pyramid::kDefaultBudgetBytes;
};

// repairPyramid() with a progress bar. Throws as that.
using PyramidRepair = RepairReport(const RepairArguments& arguments);
// isobrick-build does it: `isobrick` becomes that here, which begins anew.
PyramidRepair* pyramidRepair();

}  // namespace isobrick
