// Where voxels come from: the seam between file formats and the pyramid builder.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "storage/grid.h"
#include "storage/voxel_type.h"

namespace isobrick {

// What a source says of its volume before the first voxel is read.
struct VolumeInfo {
  Index3 voxels{0};                          // per axis 2 .. kMaxVoxelsPerAxis
  VoxelType voxel_type = VoxelType::kUint8;  // of what readSlices delivers
  GridGeometry geometry;
  std::string source;              // path, or the phantom's name: goes into the provenance
  std::string format;              // "raw", "NRRD", "DICOM series", "phantom", ...
  std::vector<std::string> notes;  // what was converted on the way in, a line each
};

// A volume that is read slice by slice, in order. Not thread-safe: one reader at a time.
class VolumeSource {
 public:
  virtual ~VolumeSource() = default;
  virtual const VolumeInfo& info() const = 0;

  // Writes slices [first, first + count) into `out`: count * voxels.y * voxels.x voxels of
  // info().voxel_type, x fastest, native byte order. Calls ask for ascending, adjoining slices,
  // beginning with 0. Throws Error (path, slice, what to do) on a short or damaged input.
  virtual void readSlices(std::int64_t first, std::int64_t count, void* out) = 0;
};

// How to read a file that has no header.
struct RawLayout {
  Index3 voxels{0};
  // "u8", "i8", "u16", "i16", "f32"; also "u32", "i32" and "f64", which become float32 with a note.
  std::string type;
  bool big_endian = false;
  glm::dvec3 spacing{1.0};
  std::uint64_t offset_bytes = 0;
};

// Opens a raw file. Throws Error where the file is shorter than offset + voxels, where it is longer
// (wrong dimensions are the usual reason; the message names both sizes), or where an axis has
// fewer than 2 voxels.
std::unique_ptr<VolumeSource> openRawSource(const std::string& path, const RawLayout& layout);

// Opens anything that ITK reads: NRRD, MetaImage, NIfTI, TIFF, ...; a folder is a DICOM series (it
// must hold exactly one) or a stack of TIFF slices. Slope and intercept, spacing, origin and
// direction are applied.
std::unique_ptr<VolumeSource> openItkSource(const std::string& path);

}  // namespace isobrick
