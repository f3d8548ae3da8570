// Which dataset of an HDF5 file is the volume, and what its program says of it elsewhere in the
// file or in the XML beside it. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/preprocess/hdf5_handle.h"
#include "isobrick/preprocess/sources/open_volume.h"
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

struct Hdf5Choice {
  std::string dataset;
  // What options.time and options.channel chose among datasets; then they are no index of an axis.
  bool took_time = false, took_channel = false;
  std::string encoding = {};  // of what they chose
  OneOfSeveral time_step = {}, channel = {};
  std::vector<VolumeChannel> named_channels = {};
  // Of BigDataViewer and Imaris, whose axes are z, y, x:
  bool is_zyx = false;
  bool holds_uint16 = false;                  // in numbers of the type int16
  std::optional<Index3> voxels = {};          // the dataset has more, to fill its chunks
  std::optional<GridGeometry> geometry = {};  // in `unit`
  std::string unit = {};
};

// The dataset `named`; if that is empty, the only one of the file, or the finest level of a
// BigDataViewer or Imaris file, at the time and of the setup or channel of the options. `name` is
// the volume's for messages, `xml` that of a BigDataViewer file, or null. Throws Error, with a
// list, if there are several to choose from. A caller holds an Hdf5Call.
Hdf5Choice chooseHdf5Dataset(hid_t file, const std::string& name, const std::string& named,
                             const BdvDataset* xml, const OpenOptions& options);

}  // namespace isobrick
