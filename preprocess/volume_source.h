// Where voxels come from: the seam between file formats and the pyramid builder.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "storage/brick_layout.h"
#include "storage/voxel_type.h"

namespace isobrick {

// What a source says of its volume before the first voxel is read.
struct VolumeInfo {
  Index3 voxels{0};                          // per axis 2 .. kMaxVoxelsPerAxis
  VoxelType voxel_type = VoxelType::kUint8;  // of what readRows and readBox deliver
  GridGeometry geometry;
  std::string source;              // path, or the phantom's name: goes into the provenance
  std::string format;              // "raw", "NRRD", "DICOM series", "phantom", ...
  std::string encoding;            // what the user, not the file, said of the stored voxels
  std::vector<std::string> notes;  // what was converted on the way in, a line each
};

// A volume that is read once, in order, a few rows at a time; or, where its file allows it, box by
// box. Errors: Error (path, slice, what to do) for input that is short or damaged, ResumableError
// where the disk failed and the same run may succeed later.
class VolumeSource {
 public:
  virtual ~VolumeSource() = default;
  virtual const VolumeInfo& info() const = 0;

  // Writes rows [first, first + count) into `out`: count * voxels.x voxels of info().voxel_type,
  // native byte order. Row r is row r % voxels.y of slice r / voxels.y. Calls ask for ascending
  // rows; what lies between the end of one call and the beginning of the next is never asked for
  // again. One thread at a time.
  virtual void readRows(std::int64_t first, std::int64_t count, void* out) = 0;

  // True where readBox() may be used instead of readRows().
  virtual bool readsBoxes() const { return false; }
  // Writes the voxels of `box`, x fastest, box.count.x * y * z of them, into `out`. Any box, in any
  // order, by any number of threads at once. Only where readsBoxes().
  virtual void readBox(const IndexBox& box, void* out) const;

  // The files that the voxels come from, in the order of their slices; none for phantoms.
  virtual std::vector<std::string> files() const { return {}; }

  // The most bytes that the source itself holds at a time while it is read: a slice that its
  // library decodes as a whole, or the whole image of a format that cannot be streamed.
  virtual std::uint64_t bufferBytes() const { return 0; }
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

// Opens VTK XML ImageData (.vti): one piece; of its point data the array that is marked as scalars,
// or the first with one value per voxel; appended (raw or base64) or inline binary, plain or
// compressed by zlib. Direction, and extents that do not begin at 0, are applied. 32- and 64-bit
// integers and doubles become float32 with a note. Throws Error for everything else, and where the
// sizes in the file contradict each other.
std::unique_ptr<VolumeSource> openVtiSource(const std::string& path);

// Opens an OpenVDB file (.vdb): its first float grid, or else its first grid of doubles, int32 or
// int64, which become float32; a note names it where there are several. The volume is the box
// around the active voxels and one voxel more on each side, so that surfaces close; what is not
// active has the value of the tree there (the background, or the inside of a level set). Values are
// as stored: distances of level sets are negative inside. The whole grid is held in memory, sparse
// as it is: bufferBytes(). Throws Error where there is no such grid, where it has no active voxels
// or a transform that is not linear, and for files that are damaged or cut short.
std::unique_ptr<VolumeSource> openVdbSource(const std::string& path);

}  // namespace isobrick
