// The peers of a benchmark, and the voxels of a pyramid as they take them: one dense block in
// memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "tools/bench/surface_engine.h"

namespace isobrick {

class Pyramid;

// Also included as C++17, for VTK's sake. Throws Error if the file is no pyramid or damaged.
class Level0Volume {
 public:
  explicit Level0Volume(const std::string& path);
  ~Level0Volume();

  std::array<std::int64_t, 3> voxels() const;
  std::array<double, 3> spacing() const;
  std::string typeName() const;  // "uint8", ..., as in voxelTypeName()
  std::size_t bytes() const;     // of all voxels
  double leastVoxel() const;

  // All voxels, x fastest, of the volume's own type, to `out` of bytes(). Uses the calling TBB
  // arena.
  void copyTo(void* out) const;

 private:
  std::unique_ptr<Pyramid> pyramid_;
};

// The grid is of float, as a grid of integers would round the isovalue; its background is the least
// voxel. Making it of the dense volume is prepare(); the dense volume goes then. `adaptivity` is
// 0 .. 1. Uses the calling TBB arena.
std::unique_ptr<SurfaceEngine> makeOpenVdbEngine(const std::string& path, double isovalue,
                                                 double adaptivity);

// `name` is that of the class: vtkFlyingEdges3D, vtkSynchronizedTemplates3D or vtkMarchingCubes;
// nullptr for another. Normals are computed, gradients and scalars are not. Sets the number of
// threads of VTK as a whole.
std::unique_ptr<SurfaceEngine> makeVtkEngine(const std::string& name, const std::string& path,
                                             double isovalue, int threads);

// The surface of vtkFlyingEdges3D, made smaller by the class `name`, vtkQuadricDecimation or
// vtkDecimatePro, which takes `reduction` of the triangles away, 0 .. 1. Topology is preserved, so
// vtkDecimatePro may leave more. Sets the number of threads of VTK as a whole.
std::unique_ptr<SurfaceEngine> makeVtkDecimation(const std::string& name, const std::string& path,
                                                 double isovalue, double reduction, int threads);

}  // namespace isobrick
