#include "tools/build/fitting_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "tools/command.h"

namespace isobrick {
namespace {

enum class Side { kInput, kOutput };

// Options, or "--select KEY", that are for some formats alone.
struct OptionFit {
  Side side;
  std::initializer_list<const char*> options;
  const char* what_for;                             // in the line that refuses it
  std::initializer_list<std::string_view> formats;  // how VolumeInfo::format of an input begins, or
                                                    // the name of an output ends
};

// A choice of component is checked when the file is opened, as it depends on the values per voxel.
const OptionFit kFits[] = {
    {Side::kInput,
     {"--select grid", "--select array"},
     "OpenVDB, VTI, slices of OpenEXR and stacks of DICOM",
     {"OpenVDB", "VTK ImageData", "OpenEXR", "DICOM"}},
    {Side::kInput,
     {"--select time"},
     "OME-Zarr, TIFF, slices of PNG and OpenEXR, HDF5, NIfTI, NRRD, MetaImage and DICOM",
     {"OME-Zarr", "Zarr", "TIFF", "PNG", "OpenEXR", "HDF5", "NIfTI", "NRRD", "MetaImage", "DICOM"}},
    {Side::kInput,
     {"--select channel"},
     "OME-Zarr, TIFF, slices of PNG and OpenEXR, HDF5, NIfTI, NRRD, MetaImage, MRC and DICOM",
     {"OME-Zarr", "Zarr", "TIFF", "PNG", "OpenEXR", "HDF5", "NIfTI", "NRRD", "MetaImage", "MRC",
      "DICOM"}},
    {Side::kInput,
     {"--select image"},
     "OME-Zarr, TIFF and MRC",
     {"OME-Zarr", "Zarr", "TIFF", "MRC"}},
    {Side::kInput, {"--select series"}, "folders of DICOM series", {"DICOM"}},
    {Side::kInput, {"--dicom-float32"}, "DICOM series", {"DICOM"}},
    {Side::kInput, {"--raw-dims"}, "files without a header", {"raw"}},
    {Side::kInput,
     {"--level", "--all-levels", "--no-map", "--with-ranges", "--with-curvature"},
     "pyramids (.isb)",
     {"isobrick pyramid"}},
    {Side::kOutput,
     {"--half", "--vdb-codec", "--vdb-background", "--vdb-tolerance", "--with-ranges",
      "--with-curvature"},
     ".vdb",
     {".vdb"}},
    {Side::kOutput, {"--zarr-version", "--zarr-shard", "--part"}, ".ome.zarr", {".zarr"}},
    {Side::kOutput, {"--lossy"}, ".vdb and slices of .exr", {".vdb", ".exr"}},
    {Side::kOutput, {"--all-levels"}, ".vdb and .ome.zarr", {".vdb", ".zarr"}},
    {Side::kOutput, {"--codec", "--no-curvature"}, ".isb", {".isb"}},
};

// "--level", or "--select time" for "--select time=3".
bool wasGiven(const CLI::App& parser, const std::string& name) {
  const std::size_t space = name.find(' ');
  const CLI::Option* const option = findOption(parser, name.substr(0, space));
  if (option == nullptr || option->count() == 0) return false;
  if (space == std::string::npos) return true;
  const std::vector<std::string> values = option->results();
  return std::any_of(values.begin(), values.end(), [&](const std::string& value) {
    return value.starts_with(name.substr(space + 1) + "=");
  });
}

template <typename Fits>
void refuseUnfit(const CLI::App& parser, Side side, const std::string& name, const char* is_what,
                 const Fits& fits) {
  for (const OptionFit& fit : kFits)
    for (const char* const option : fit.options)
      if (fit.side == side && wasGiven(parser, option) &&
          std::none_of(fit.formats.begin(), fit.formats.end(), fits))
        throw UsageError(fmt::format("{} is for {}, and '{}' is {}; leave it out", option,
                                     fit.what_for, name, is_what));
}

}  // namespace

void refuseUnfitInputOptions(const CLI::App& parser, const VolumeInfo& input) {
  refuseUnfit(parser, Side::kInput, input.source, input.format.c_str(),
              [&](std::string_view format) { return input.format.starts_with(format); });
}

void refuseUnfitOutputOptions(const CLI::App& parser, const std::string& output) {
  refuseUnfit(parser, Side::kOutput, output, "none",
              [&](std::string_view ending) { return output.ends_with(ending); });
}

}  // namespace isobrick
