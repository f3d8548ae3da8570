// Writing volumes to files that other programs read.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/cancel.h"

namespace isobrick {

struct VolumeWriteOptions {
  // Called now and then with the share that is done, 0 .. 1, by one thread at a time.
  std::function<void(double fraction)> progress;
  // Looked at after every MiB, and while the disk is waited for: throws Cancelled, and no file is
  // left.
  const CancelFlag* cancel = nullptr;
  // Bounds what the writer holds beside the source's own buffers; at least a row.
  std::uint64_t memory_bytes = std::uint64_t{16} << 20;
  // Called when everything is written and nothing has its name yet: what it throws leaves no file.
  std::function<void()> before_publishing;
};

// What became of a volume.
struct VolumeWriteReport {
  std::uint64_t bytes = 0;        // of all files
  std::string space;              // what the file's world coordinates are, such as "LPS"
  std::vector<std::string> lost;  // what the format could not keep, a line each, without its name
};

// True for endings that writeVolume() knows.
bool isPlainVolumeName(const std::string& path);

// Reads `source` from its first slice to its last and writes `path`, little-endian. World
// coordinates of the source count as LPS (DICOM, ITK); its unit of length is written where the
// format has a place for it. The ending decides:
//   .nrrd    one file, with type, sizes, space, directions and origin
//   .mhd     MetaImage: a header, and the voxels beside it under the same name with .raw
//   .mha     MetaImage: both in one file
//   .nii     NIfTI-1: sform and qform in RAS, single precision; at most 32767 voxels an axis
//   .nii.gz  the same, packed with gzip
//   .vti     VTK ImageData, appended raw, with Direction
//   .raw     the voxels alone: dimensions, type and geometry are lost
// Files appear under their names when they are whole, and replace older ones. No library of these
// formats is used: each is a header and a run of voxels, and ITK's writers want the whole image.
//
// Throws Error for other endings, for what the format cannot hold, for what the source throws, and
// for failed writes (storage/atomic_file.h).
VolumeWriteReport writeVolume(VolumeSource& source, const std::string& path,
                              const VolumeWriteOptions& options = {});

}  // namespace isobrick
