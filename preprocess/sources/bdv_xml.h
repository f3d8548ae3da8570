// The XML file of a BigDataViewer dataset. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "isobrick/storage/grid.h"

namespace isobrick {

struct BdvDataset {
  std::string hdf5_path;
  // Of voxels of the finest level: of each setup their size, and for setup and time point their
  // place, if the file has one. In `units`, by setup; "" if none is said.
  std::map<std::int64_t, glm::dvec3> voxel_sizes;
  std::map<std::int64_t, std::string> units;
  std::map<std::pair<std::int64_t, std::int64_t>, glm::dmat4> places;
  std::string xml_path;

  // Throws Error if size and place contradict each other.
  GridGeometry geometryOf(std::int64_t setup, std::int64_t time) const;
};

// Throws Error for XML of another kind, and for datasets that are not kept in HDF5.
BdvDataset readBdvXml(const std::string& path);

}  // namespace isobrick
