// What an HDF5 dataset needs beside its own file. Private to preprocess/sources/.
#pragma once

#include <string>
#include <vector>

#include "isobrick/preprocess/hdf5_handle.h"
#include "isobrick/preprocess/sources/open_volume.h"

namespace isobrick {

struct Hdf5Needs {
  std::vector<std::string> files;     // that it takes its voxels from
  bool raw_files_lie_beside = false;  // where the library does not search
};

// Of the dataset in `file`, which lies at `path`: of a virtual one the files of its sources, and of
// one outside of HDF5 its raw files. The library gives fill values for sources that it does not
// find. Throws Error if one is missing, or a filter of any of the datasets. `name` is the volume's
// for messages. A caller holds an Hdf5Call.
Hdf5Needs checkHdf5Needs(hid_t dataset, hid_t file, const std::string& path,
                         const std::string& name, const OpenOptions& options);

}  // namespace isobrick
