// Writing volumes to files that other programs read.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// How a volume is written.
struct VolumeWriteOptions {
  // Called now and then with the share that is done, 0 .. 1, by one thread at a time.
  std::function<void(double fraction)> progress;
  // Checked after every MiB, and while the disk is busy; writeVolume() then throws Cancelled and
  // leaves no file.
  const CancelFlag* cancel = nullptr;
  // Bounds the writer's buffers, beside the source's own; at least a row.
  std::uint64_t memory_bytes = std::uint64_t{16} << 20;
  // Called when everything is written and nothing has its name yet: if it throws, no file is left.
  std::function<void()> before_publishing;
};

// Result of writing a volume.
struct VolumeWriteReport {
  std::uint64_t bytes = 0;        // of all files
  std::string space;              // of the file's world coordinates, such as "LPS"
  std::vector<std::string> lost;  // each thing that the format cannot keep, a line each
};

// The endings that writeVolume() takes.
std::vector<std::string> plainVolumeEndings();
// True if the name has one of these endings.
bool isPlainVolumeName(const std::string& path);

// Reads `source` from its first slice to its last and writes `path`, little-endian. World
// coordinates of the source count as LPS (DICOM, ITK); its unit of length is written if the
// format has a place for it. The ending decides:
//   .nrrd    one file, with type, sizes, space, directions and origin
//   .mhd     MetaImage: a header, and the voxels beside it under the same name with .raw
//   .mha     MetaImage: both in one file
//   .nii     NIfTI-1: sform and qform in RAS, single precision; at most 32767 voxels an axis
//   .nii.gz  the same, packed with gzip
//   .vti     VTK ImageData, appended raw, with Direction
//   .raw     the voxels alone: dimensions, type and geometry are lost
// Files appear under their names when they are whole, and replace older ones. No library of these
// formats is used: each is a header and a run of voxels, and ITK's writers need the whole image.
//
// Throws Error for other endings, for volumes that the format cannot hold and for failed writes
// (storage/atomic_file.h), and whatever the source throws.
VolumeWriteReport writeVolume(VolumeSource& source, const std::string& path,
                              const VolumeWriteOptions& options = {});

}  // namespace isobrick
