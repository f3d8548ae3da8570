// Headers of NRRD and MetaImage files as text: their fields, and the files that they name. ITK's
// own readers of both give geometry and voxel type, but neither the names of all data files nor the
// first byte of the voxels, so these fields are read here a second time. Private to
// preprocess/sources/.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace isobrick {

struct HeaderText {
  // By their names in lower case; names of NRRD without blanks: "data file" and "datafile" are one.
  std::map<std::string, std::string> fields;
  std::vector<std::string> listed;   // the lines behind a data file that is called LIST
  std::optional<std::uint64_t> end;  // the byte behind the header, if it has an end

  // The field's value, or "".
  std::string value(const std::string& name) const;
};

// Nothing if the file is no such header, or is too long for one. Never throw for its content.
std::optional<HeaderText> readNrrdHeader(const std::string& path);
std::optional<HeaderText> readMetaImageHeader(const std::string& path);

// The header itself, and then every file that it names, LIST and patterns ("slice%03d.raw 1 9 1")
// included, in the order of their slices; the header alone if the voxels are in it or if it is no
// such header. At most as many as the volume has slices. Throw Error for patterns that are not one
// whole number in a name: the libraries that read these files would pass them on to printf, or
// count for minutes if there are more numbers than a volume can have slices.
std::vector<std::string> nrrdFiles(const std::string& header_path);
std::vector<std::string> metaImageFiles(const std::string& header_path);

// The units of length of the world's axes (length_units.h), "" if none is stated. An NRRD in a
// space of patients or scanners, such as left-posterior-superior, is in millimetres unless it says
// otherwise: the format takes those spaces from DICOM and NIfTI. A MetaImage is in millimetres
// unless it says otherwise.
std::array<std::string, 3> nrrdUnits(const std::string& header_path);
std::string metaImageUnit(const std::string& header_path);

// A name in a header is relative to the header's folder.
std::string besideHeader(const std::string& header_path, const std::string& name);

}  // namespace isobrick
