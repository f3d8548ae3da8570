// Names of datasets in HDF5 files: "scan.h5:/entry/data".
#pragma once

#include <string>
#include <utility>

namespace isobrick {

// Splits "scan.h5:/entry/data" into its file and its dataset, which is empty if none is named; the
// whole word is the file if it has no such form (.h5, .hdf5, .hdf, .he5, .nxs, .nc, .ims, .mat).
std::pair<std::string, std::string> splitHdf5Name(const std::string& name);
// Whether the file has one of these endings.
bool isHdf5Name(const std::string& name);

}  // namespace isobrick
