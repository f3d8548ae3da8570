// Which axes of an HDF5 dataset are x, y and z, the index along all others, and where the voxels
// lie. Private to preprocess/sources/.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "isobrick/preprocess/hdf5_handle.h"
#include "isobrick/preprocess/sources/hdf5_choice.h"
#include "isobrick/preprocess/sources/hdf5_objects.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

struct Hdf5Axes {
  std::array<std::size_t, 3> of_space{};  // which axis of the dataset x, y and z are
  std::vector<hsize_t> fixed;             // the index along each of the others, 0 for those
  std::string encoding;                   // of the choice
  OneOfSeveral time_step, channel;        // that were chosen
  std::vector<double> resolutions;        // of all axes, as Vigra's tags state them, or none
};

// By the names that the file has for its axes (ilastik's "axistags", labels and scales of
// dimensions), or else the last three of more than one element, slowest first. One further axis is
// taken at options.time or options.channel, two by their names, or as time and channel. Throws
// Error if there are fewer than three axes of space, if a choice is missing, with a list, or if
// there is nothing to choose. `name` is the volume's for messages. A caller holds an Hdf5Call.
Hdf5Axes findHdf5Axes(hid_t dataset, const std::string& name, const std::vector<hsize_t>& dims,
                      const std::vector<Hdf5Scale>& scales, const Hdf5Choice& choice,
                      const OpenOptions& options);

// Sets the geometry of `info` by the first of these that the file has, and notes which units were
// converted: isobrick's own attributes, what BigDataViewer or Imaris say, "element_size_um", scales
// of the axes, the resolutions of Vigra. Throws Error if scales are uneven, unless the user gave a
// spacing. A caller holds an Hdf5Call.
void placeHdf5(hid_t dataset, const Hdf5Choice& choice, const Hdf5Axes& axes,
               const std::vector<Hdf5Scale>& scales, bool is_spacing_given, VolumeInfo& info);

}  // namespace isobrick
