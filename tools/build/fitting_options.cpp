#include "tools/build/fitting_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <initializer_list>
#include <string_view>

#include "tools/command.h"

namespace isobrick {
namespace {

using Names = std::initializer_list<std::string_view>;

struct OptionFit {
  const char* option;
  const char* what_for;  // in the line that refuses it
  Names formats;         // how they begin, or how the file's name ends
};

// As VolumeInfo::format begins. A choice of component is looked at where the file is opened, which
// knows how many values a voxel has.
const OptionFit kOfInputs[] = {
    {"--grid",
     "OpenVDB, VTI, slices of OpenEXR and stacks of DICOM",
     {"OpenVDB", "VTK ImageData", "OpenEXR", "DICOM"}},
    {"--time", "OME-Zarr, NIfTI and DICOM", {"OME-Zarr", "Zarr", "NIfTI", "DICOM"}},
    {"--channel", "OME-Zarr, HDF5 and DICOM", {"OME-Zarr", "Zarr", "HDF5", "DICOM"}},
    {"--series", "folders of DICOM series", {"DICOM"}},
    {"--dicom-float32", "DICOM series", {"DICOM"}},
    {"--raw-dims", "files without a header", {"raw"}},
    {"--level", "pyramids (.isb)", {"isobrick pyramid"}},
    {"--levels", "pyramids (.isb)", {"isobrick pyramid"}},
    {"--no-map", "pyramids (.isb)", {"isobrick pyramid"}},
};

// As the name of the output ends.
const OptionFit kOfOutputs[] = {
    {"--half", ".vdb", {".vdb"}},      {"--background", ".vdb", {".vdb"}},
    {"--tolerance", ".vdb", {".vdb"}}, {"--levels", ".vdb and .ome.zarr", {".vdb", ".zarr"}},
    {"--codec", ".isb", {".isb"}},     {"--no-curvature", ".isb", {".isb"}},
    {"--error", ".isb", {".isb"}},
};

template <typename Table, typename Fits>
void refuseUnfit(const CLI::App& parser, const Table& table, const std::string& name,
                 const char* is_what, const Fits& fits) {
  for (const OptionFit& fit : table) {
    const CLI::Option* const option = findOption(parser, fit.option);
    if (option == nullptr || option->count() == 0) continue;
    if (std::none_of(fit.formats.begin(), fit.formats.end(), fits))
      throw UsageError(fmt::format("{} is for {}, and '{}' is {}; leave it out", fit.option,
                                   fit.what_for, name, is_what));
  }
}

}  // namespace

void refuseUnfitInputOptions(const CLI::App& parser, const VolumeInfo& input) {
  refuseUnfit(parser, kOfInputs, input.source, input.format.c_str(),
              [&](std::string_view format) { return input.format.starts_with(format); });
}

void refuseUnfitOutputOptions(const CLI::App& parser, const std::string& output) {
  refuseUnfit(parser, kOfOutputs, output, "none",
              [&](std::string_view ending) { return output.ends_with(ending); });
}

}  // namespace isobrick
