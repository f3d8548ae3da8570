// Arrays of a file with more axes than a volume has: which of them are the volume's, and the choice
// of one time step, component or image. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/number_files.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

struct StoredAxis {
  // kValues: of voxels with several; the file does not say whether they are components, channels or
  // time steps if it is kUnnamed.
  enum class Use { kSpace, kValues, kUnnamed, kTime, kImages };
  std::int64_t size = 1;
  Use use = Use::kSpace;
};

struct StoredArray {
  std::vector<StoredAxis> axes;  // fastest first; three of space at most, which are x, y, z
  StoredVoxels stored;           // of one number
  NumberFiles files;
};

// The voxels along the axes of space. Throws Error for volumes that are too small or too large.
Index3 volumeVoxels(const std::string& path, const std::vector<StoredAxis>& axes);

// The volume that the options choose. `info` has source, format, voxels and geometry; its type,
// encoding and notes of the choice are added. Of time steps the first is taken without a choice,
// with a note. Throws Error if another choice is missing, with what there is; if one is given that
// the array has no axis for; and if the files are too short.
std::unique_ptr<VolumeSource> openStoredArray(VolumeInfo info, const StoredArray& array,
                                              const OpenOptions& options);

}  // namespace isobrick
