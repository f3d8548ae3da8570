// OpenVDB's volumeToMesh over a whole volume.
#pragma once

#include <memory>
#include <string>

#include "tools/bench/surface_engine.h"

namespace isobrick {

// The grid is of float, as a grid of integers would round the isovalue; its background is the least
// voxel. Making it of the dense volume is prepare(); the dense volume goes then. `adaptivity` is
// 0 .. 1. Uses the calling TBB arena.
std::unique_ptr<SurfaceEngine> makeOpenVdbEngine(const std::string& path, double isovalue,
                                                 double adaptivity);

}  // namespace isobrick
