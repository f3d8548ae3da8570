// A mask of another grid, seen from the voxels of a volume.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <optional>

#include "isobrick/extract/surface_region.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The way from a volume's voxels to those of a mask. Read by MaskReader.
class MaskVoxels {
 public:
  // Throws Error if the mask is no part of the volume's world: its unit is another one, though the
  // grids differ, or it lies elsewhere; and if its voxels cannot tell the value apart.
  MaskVoxels(const RegionMask& mask, const Pyramid& volume);

 private:
  friend class MaskReader;
  std::shared_ptr<const Pyramid> pyramid_;
  bool has_value_;           // false: all but 0
  double stored_ = 0;        // the value, or 0, in numbers of the mask
  double tolerance_ = 1e-6;  // of those: decimal fractions are none of the voxels'
  glm::dmat3 to_mask_{1.0};
  glm::dvec3 first_{0.0};  // of the volume, in the mask
};

// Looks voxels up; keeps the brick that it looked into last. By one thread at a time.
class MaskReader {
 public:
  // Holds nothing. `mask` outlives its use.
  MaskReader(const MaskVoxels& mask, const CancelFlag* cancel) : mask_(mask), cancel_(cancel) {}

  // True if the voxel is in the mask. Throws Error if the mask cannot be read, and Cancelled.
  bool has(const Index3& voxel);
  // Throws Error if bytes could not be read while has() used them: then it said nothing. Call it
  // before what follows from it is passed on.
  void throwIfReadsFailed() const;

 private:
  bool isIn(double stored) const;

  const MaskVoxels& mask_;
  const CancelFlag* const cancel_;
  IndexBox box_;  // of the brick at hand, and the brick
  Index3 brick_{0};
  BrickSamples samples_;
  std::optional<bool> all_;  // its voxels are in the mask, or not
};

}  // namespace isobrick
