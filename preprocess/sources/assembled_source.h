// A volume that lies in its file in several boxes. Private to preprocess/sources/.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

struct VolumePart {
  Index3 first{0};                       // of its voxels, in the whole
  std::unique_ptr<VolumeSource> source;  // of the whole's voxel type
};

// `info` is that of the whole. Parts may overlap: the later one counts. They are read in order, a
// row at a time. Throws Error, naming the place, if a voxel lies in none.
std::unique_ptr<VolumeSource> makeAssembledSource(VolumeInfo info, std::vector<VolumePart> parts,
                                                  std::vector<std::string> files);

}  // namespace isobrick
