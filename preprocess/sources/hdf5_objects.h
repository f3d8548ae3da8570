// What an HDF5 file has beside its voxels: names, attributes, scales of axes. Private to the files
// that read HDF5; a caller holds an Hdf5Call.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "isobrick/preprocess/hdf5_handle.h"

namespace isobrick {

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

}  // namespace isobrick
