// Places of samples: voxel indices, the pyramid's lattices, and the way to world space.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <glm/vec3.hpp>
#include <string_view>

namespace isobrick {

// A count or an index per axis; x is the fastest axis, then y, then z.
using Index3 = glm::i64vec3;

// Greatest number of voxels along one axis. Edge identities (extract/sinks/triangle_sink.h) hold 20
// bits an axis.
inline constexpr std::int64_t kMaxVoxelsPerAxis = std::int64_t{1} << 20;

// Number of elements of a dense block of `dims`. The caller has checked that dims are within
// kMaxVoxelsPerAxis, so that the product fits 64 bits.
constexpr std::int64_t elementCount(const Index3& dims) { return dims.x * dims.y * dims.z; }

// The unit of a volume's lengths: millimetres if the input's unit is known, so that a volume in
// micrometres is scaled. The values are those of the file format.
enum class LengthUnit : std::uint32_t { kUnknown = 0, kMillimetre = 1 };

// "unknown" or "millimetres".
constexpr std::string_view lengthUnitName(LengthUnit unit) {
  return unit == LengthUnit::kMillimetre ? "millimetres" : "unknown";
}

// The placement of a volume in world space: world = origin + direction * (spacing * index).
// The columns of `direction` are the world directions of the index axes; orthonormal, and of either
// handedness (a flipped axis has determinant -1).
struct GridGeometry {
  glm::dvec3 spacing{1.0};                 // from a voxel to the next, per index axis; above 0
  glm::dvec3 origin{0.0};                  // of voxel (0, 0, 0)
  glm::dmat3 direction{1.0};               // see above
  LengthUnit unit = LengthUnit::kUnknown;  // of spacing, origin and all that is in world space

  // d(world)/d(index).
  glm::dmat3 indexToWorldMatrix() const {
    return glm::dmat3(direction[0] * spacing.x, direction[1] * spacing.y, direction[2] * spacing.z);
  }
  // Of the three axes: the unit of lengths that are given in voxels.
  double leastSpacing() const { return std::min({spacing.x, spacing.y, spacing.z}); }
  // From voxel indices, which need not be whole, to the world.
  glm::dvec3 indexToWorld(const glm::dvec3& index) const {
    return origin + direction * (spacing * index);
  }
  // The way back.
  glm::dvec3 worldToIndex(const glm::dvec3& world) const {
    return glm::inverse(indexToWorldMatrix()) * (world - origin);
  }
};

// The outermost voxels of a volume in the world; x runs fastest, from the first voxel to the last.
inline std::array<glm::dvec3, 8> worldCorners(const GridGeometry& geometry, const Index3& voxels) {
  const glm::dvec3 last(voxels - Index3(1));
  std::array<glm::dvec3, 8> corners;
  for (unsigned i = 0; i < 8; ++i)
    corners[i] = geometry.indexToWorld(
        {i & 1u ? last.x : 0.0, i & 2u ? last.y : 0.0, i & 4u ? last.z : 0.0});
  return corners;
}

// The lattices of all levels of one volume (rule 1 of the design). Sample (i,j,k) of level l sits
// at voxel index (i,j,k) * 2^l exactly. If that is past the last voxel (only the last sample of
// an axis can be), the sample repeats the last voxel and sits on it: the last cell of a level is
// thinner than the others, no position leaves the volume, and a linear field stays exact.
class Lattice {
 public:
  Lattice() = default;
  // `voxels`: per axis 2 .. kMaxVoxelsPerAxis.
  explicit Lattice(const Index3& voxels) : voxels_(voxels) {
    const std::int64_t most = std::max({voxels.x, voxels.y, voxels.z}) - 1;
    while ((std::int64_t{1} << (levels_ - 1)) < most) ++levels_;
  }

  // Number of levels: the coarsest is the first that has a single cell.
  int levels() const { return levels_; }
  // As given to the constructor.
  const Index3& voxels() const { return voxels_; }

  // Cells of level l: per axis ceil((voxels - 1) / 2^l), at least 1.
  Index3 cells(int level) const {
    const std::int64_t step = std::int64_t{1} << level;
    return (voxels_ + Index3(step - 2)) >> std::int64_t{level};  // a division would be slow
  }
  // Samples of level l: cells + 1.
  Index3 samples(int level) const { return cells(level) + Index3(1); }

  // Voxel index at which sample `i` of `level` sits along `axis`.
  std::int64_t position(int level, int axis, std::int64_t i) const {
    return std::min(i << level, voxels_[axis] - 1);
  }
  // The same along all axes.
  Index3 position(int level, const Index3& sample) const {
    return {position(level, 0, sample.x), position(level, 1, sample.y),
            position(level, 2, sample.z)};
  }

 private:
  Index3 voxels_{2, 2, 2};
  int levels_ = 1;
};

}  // namespace isobrick
