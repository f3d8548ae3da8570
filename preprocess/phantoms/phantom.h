// Analytic test volumes of any size: ground truth for tests, and data of any size for benchmarks.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// The field as a function is in units of its own, listed here; all lengths are in voxels, and the
// volume is [0, size - 1]^3. Greater values are inside (value >= isovalue).
//
//   name            isovalue  field
//   sphere          0         signed distance to a sphere, positive inside
//   torus           0         signed distance to a torus around the z axis, positive inside
//   plane           0         signed distance to an oblique plane
//   gyroid          0         sin X cos Y + sin Y cos Z + sin Z cos X, in -1.5 .. 1.5; dense: one
//                             period is `gyroid_period` voxels, whatever the size
//   marschner-lobb  0.5       the test signal of Marschner and Lobb (1994) with f_M = 6 and
//                             alpha = 0.25 on [-1, 1]^3; values 0 .. 1
//   head            1324      a CT-like head; values are HU + 1024 (air 0 .. 24, soft tissue about
//                             1000 .. 1100, bone 1300 .. 3200). 1324 is bone, 500 is skin
struct PhantomSpec {
  std::string name;         // one of these
  std::int64_t size = 256;  // voxels per axis, 2 .. kMaxVoxelsPerAxis
  // Type of the stored voxels; without it uint16 for head, uint8 for gyroid, float32 for others.
  std::optional<VoxelType> voxel_type = {};
  double gyroid_period = 16;  // in voxels, > 0
};

// The known constants of the surfaces, in voxel index coordinates.
struct PhantomConstants {
  glm::dvec3 center{0.0};         // of sphere, torus and Marschner-Lobb signal: the volume's
  double sphere_radius = 0;       // 0.35 (size - 1)
  double torus_major_radius = 0;  // of the circle, 0.28 (size - 1)
  double torus_minor_radius = 0;  // of the tube, 0.11 (size - 1)
  glm::dvec3 plane_normal{0.0};   // unit; the plane is dot(plane_normal, p) = plane_offset, and
  double plane_offset = 0;        // values rise along the normal
  double gyroid_period = 0;       // in voxels
  glm::dvec3 gyroid_origin{0.0};  // X = 2 pi (x - gyroid_origin.x) / gyroid_period, and so on
  double marschner_lobb_frequency = 6;  // f_M
  double marschner_lobb_alpha = 0.25;   // alpha
};

// How field values become voxels: stored = offset + scale * value, for integer types rounded to
// nearest and clamped to what the type holds.
//
//                                 uint8          int8           uint16           int16     float32
//   sphere, torus, plane          128 + 16 v     16 v           32768 + 256 v    256 v     v
//   gyroid                        128 + 84 v     84 v           32768 + 20000 v  20000 v   v
//   marschner-lobb                255 v          -128 + 255 v   65535 v          32767 v   v
//   head                          v / 16         -128 + v / 16  v                v         v
struct PhantomScale {
  double offset = 0;  // stored for 0
  double scale = 1;   // stored for a unit of the field
  // The number stored for a value of the field, before it is rounded and clamped.
  double stored(double value) const { return offset + scale * value; }
};

// One phantom as a function. All members are thread-safe.
class Phantom {
 public:
  // Throws Error for an unknown name (the message lists all names) and a size out of range.
  explicit Phantom(const PhantomSpec& spec);

  // As given to the constructor.
  const PhantomSpec& spec() const { return spec_; }
  // The constants of its surface.
  const PhantomConstants& constants() const { return constants_; }
  // The type of the voxels that fillRow() writes.
  VoxelType voxelType() const { return voxel_type_; }
  // From the field to voxels.
  const PhantomScale& scale() const { return scale_; }

  // The isovalue to use, in units of the field and of the stored voxels.
  double isovalue() const;
  // The same in units of the stored voxels.
  double storedIsovalue() const { return scale_.stored(isovalue()); }

  // The field at continuous voxel index coordinates, in field units.
  double value(double x, double y, double z) const;
  // The same.
  double value(const glm::dvec3& p) const { return value(p.x, p.y, p.z); }

  // d(value)/d(voxel index), analytic. Not for head, which has none: throws std::logic_error. At
  // the few points at which the field is not differentiable (the sphere's centre, the torus's
  // circle and axis) the undefined part is 0.
  glm::dvec3 gradient(const glm::dvec3& p) const;

  // Writes `count` voxels of voxelType() from `first` on along x, within the volume. Exactly
  // value() at every voxel, stored as described at PhantomScale.
  void fillRow(const Index3& first, std::int64_t count, void* out) const;

 private:
  enum class Kind { kHead, kSphere, kTorus, kGyroid, kMarschnerLobb, kPlane };
  static Kind kindOf(const std::string& name);

  template <typename T>
  void fillTypedRow(const Index3& first, std::int64_t count, T* out) const;

  PhantomSpec spec_;
  Kind kind_;
  PhantomConstants constants_;
  VoxelType voxel_type_;
  PhantomScale scale_;
  std::vector<double> sin_x_, cos_x_;  // of the gyroid, for every voxel of a row
};

// All names, in the order of the documentation.
std::vector<std::string> phantomNames();

// The phantom as a volume with unit spacing. Rows are made independently of each other, by all
// threads that TBB has; the bytes depend on the spec alone.
std::unique_ptr<VolumeSource> makePhantomSource(const PhantomSpec& spec);

}  // namespace isobrick
