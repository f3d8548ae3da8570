// What an HDF5 file says of a dataset beside its voxels: which one is the volume, which of its axes
// are x, y and z, where the voxels lie, and what it needs beside its own file. Private to the files
// that read HDF5; a caller holds an Hdf5Call.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/preprocess/hdf5_handle.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// ---- names, attributes and scales of axes: hdf5_objects.cpp

// "cannot use 'FILE:/DATASET': WHY"; `name` is the volume's.
template <typename... Parts>
Error unusableDataset(const std::string& name, const Parts&... why) {
  return fileError(splitHdf5Name(name).first, "cannot use '", name, "': ", why...);
}

// The library's words, in quotes, for its call that failed just now; "" if it has none.
std::string hdf5Reason();

// Names of the links in a group, but no more than some thousands; none if it is no group.
std::vector<std::string> linkNames(hid_t group);

// Datasets of three axes or more below a group: all that lie there, or, if none does, those of soft
// and external links. Up to kMostDatasets + 1.
inline constexpr std::size_t kMostDatasets = 12;
std::vector<std::string> datasetNames(hid_t file);

// An attribute, which need not be there.
class Hdf5Attribute {
 public:
  Hdf5Attribute(hid_t object, const char* name);
  // All of them, whatever its shape; none if it is missing, no numbers or very long.
  std::vector<double> numbers() const;
  // None unless it has so many.
  std::vector<double> numbers(std::size_t count) const;
  // All of its texts, or none.
  std::vector<std::string> texts() const;
  // Its one text, or its characters if these are texts of their own; "" if it is missing.
  std::string text() const;

 private:
  Hdf5Handle attribute_, type_, space_;
  H5T_class_t kind_ = H5T_NO_CLASS;
  std::size_t count_ = 0;
};

// A dataset that another one names as the scale of an axis; without one everything is empty.
struct Hdf5Scale {
  std::string name;            // the last part of its path
  std::vector<double> values;  // of one axis, or none
  std::string units;
};
// For every axis of the dataset.
std::vector<Hdf5Scale> axisScales(hid_t dataset, std::size_t axes);

// ---- which dataset is the volume, and what its program says of it elsewhere in the file or in the
// XML beside it: hdf5_choice.cpp

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
// list, if there are several to choose from.
Hdf5Choice chooseHdf5Dataset(hid_t file, const std::string& name, const std::string& named,
                             const BdvDataset* xml, const OpenOptions& options);

// ---- which axes are x, y and z, the index along all others, and where the voxels lie:
// hdf5_axes.cpp

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
// there is nothing to choose. `name` is the volume's for messages.
Hdf5Axes findHdf5Axes(hid_t dataset, const std::string& name, const std::vector<hsize_t>& dims,
                      const std::vector<Hdf5Scale>& scales, const Hdf5Choice& choice,
                      const OpenOptions& options);

// Sets the geometry of `info` by the first of these that the file has, and notes which units were
// converted: isobrick's own attributes, what BigDataViewer or Imaris say, "element_size_um", scales
// of the axes, the resolutions of Vigra. Throws Error if scales are uneven, unless the user gave a
// spacing.
void placeHdf5(hid_t dataset, const Hdf5Choice& choice, const Hdf5Axes& axes,
               const std::vector<Hdf5Scale>& scales, bool is_spacing_given, VolumeInfo& info);

// ---- what it needs beside its own file: hdf5_needs.cpp

struct Hdf5Needs {
  std::vector<std::string> files;     // that it takes its voxels from
  bool raw_files_lie_beside = false;  // where the library does not search
};

// Of the dataset in `file`, which lies at `path`: of a virtual one the files of its sources, and of
// one outside of HDF5 its raw files. The library gives fill values for sources that it does not
// find. Throws Error if one is missing, or a filter of any of the datasets. `name` is the volume's
// for messages.
Hdf5Needs checkHdf5Needs(hid_t dataset, hid_t file, const std::string& path,
                         const std::string& name, const OpenOptions& options);

}  // namespace isobrick
