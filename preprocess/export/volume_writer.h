// Writing volumes to files that other programs read.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/cancel.h"

namespace isobrick {

struct VolumeWriteOptions {
  // Called after every slab with the share that is done, 0 .. 1, from the calling thread.
  std::function<void(double fraction)> progress;
  // Looked at after every MiB, and while the disk is waited for: throws Cancelled, and no file is
  // left.
  const CancelFlag* cancel = nullptr;
  // So often progress is told; at least a slice.
  std::uint64_t slab_bytes = std::uint64_t{16} << 20;
};

// Reads `source` from its first slice to its last and writes `path`, little-endian and
// uncompressed. The ending decides:
//   .nrrd  one file, with type, sizes, space directions and origin (world taken as LPS)
//   .mhd   a header, and the voxels beside it under the same name with .raw
//   .raw   the voxels alone: dimensions, type and geometry are lost
// Files appear under their names when they are whole, and replace older ones. Throws Error for
// other endings, for what the source throws, and for failed writes (storage/atomic_file.h).
void writeVolume(VolumeSource& source, const std::string& path,
                 const VolumeWriteOptions& options = {});

}  // namespace isobrick
