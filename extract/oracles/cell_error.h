// The error of single cells of level 1, where something is known of their corners (rule 15).
#pragma once

#include "isobrick/extract/kernels/error_flags.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Looks at the cells of level 1 in one brick of level 0, one after the other. T is the voxel type.
template <typename T>
class CellError {
 public:
  // The samples of the brick and of the one of level 1 over it; all arguments outlive the object.
  CellError(const Lattice& lattice, const BrickSamples& voxels, const BrickSamples& samples,
            const ErrorBound& bound)
      : lattice_(lattice), voxels_(voxels), samples_(samples), bound_(bound) {}

  // The cell that is asked about from now on, by its index on level 1.
  void load(const Index3& cell);

  // Whether it has voxels inside and outside, the lower faces' and the upper faces' included.
  bool isCrossed() const;

  // A bit for each corner, x + 2y + 4z.
  static constexpr unsigned kAllCorners = 0xff;

  // Whether a crossing on an edge of level 0 in the closed cell lies where level 0 is beyond the
  // tolerance, or a voxel in it that is beyond comes to the wrong side: of the field of a leaf with
  // samples of level 0 at `fine_corners`, and at the others with any values between the samples of
  // both levels.
  bool isBeyondWithin(unsigned fine_corners);
  // The same, and of edges that lead away from the cell too, from points that hang on it.
  bool isBeyond(unsigned fine_corners);

 private:
  // Voxel (x, y, z) of the closed cell is number x + 3y + 9z of all of these. What lies behind the
  // last one is read with the rows.
  static constexpr std::size_t kVoxels = 27, kRoom = kVoxels + 9 + kErrorLanes;
  using Values = float[kRoom];
  struct Field {
    Values value, low, high;
  };

  void bound(unsigned fine_corners);
  bool isBeyondAround() const;  // as bound
  void interpolate(const float (&corners)[8], Values& field) const;
  float voxel(const Index3& at) const {
    return static_cast<float>(
        voxels_.data<T>()[linearIndex(at - voxels_.box.first, voxels_.box.count)]);
  }

  const Lattice& lattice_;
  const BrickSamples& voxels_;
  const BrickSamples& samples_;
  const ErrorBound& bound_;
  Index3 lower_{0};  // voxel
  Index3 steps_{2};  // from there to the upper one; 1 where the cell is thin
  Field field_ = {};
  float fine_[8] = {}, coarse_[8] = {};  // samples at the corners
};

}  // namespace isobrick
