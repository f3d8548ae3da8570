// Where the voxels of an HDF5 dataset lie. Private to preprocess/sources/.
#pragma once

#include <vector>

#include "isobrick/preprocess/sources/hdf5_axes.h"
#include "isobrick/preprocess/sources/hdf5_choice.h"
#include "isobrick/preprocess/sources/hdf5_objects.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Sets the geometry of `info` by the first of these that the file has, and notes which units were
// converted: isobrick's own attributes, what BigDataViewer or Imaris say, "element_size_um", scales
// of the axes, the resolutions of Vigra. Throws Error if scales are uneven, unless the user gave a
// spacing. A caller holds an Hdf5Call.
void placeHdf5(hid_t dataset, const Hdf5Choice& choice, const Hdf5Axes& axes,
               const std::vector<Hdf5Scale>& scales, bool is_spacing_given, VolumeInfo& info);

}  // namespace isobrick
