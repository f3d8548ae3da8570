#include "isobrick/preprocess/sources/open_volume.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <string_view>

#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/value_fit.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

// Endings of files that have no header.
constexpr std::array<std::string_view, 8> kRawEndings = {".raw", ".bin", ".dat", ".vol",
                                                         ".u8",  ".u16", ".i16", ".f32"};

Error leftOut(const std::string& path, const char* library) {
  return unreadable(path, "this isobrick was built without ", library,
                    "; build it anew with that, or convert the file to .vti or raw voxels");
}

using OpenedSource = std::unique_ptr<VolumeSource>;
// What is discarded here need not be there.
OpenedSource openVdb(const std::string& path, const OpenOptions& options) {
  if constexpr (ISOBRICK_WITH_OPENVDB) return openVdbSource(path, options);
  throw leftOut(path, "OpenVDB");
}
OpenedSource openExr(const std::string& path, const OpenOptions& options) {
  if constexpr (ISOBRICK_WITH_OPENEXR) return openExrSlices(path, options);
  throw leftOut(path, "OpenEXR");
}
OpenedSource openHdf5(const std::string& path, const OpenOptions& options) {
  if constexpr (ISOBRICK_WITH_HDF5) return openHdf5Source(path, options);
  throw leftOut(path, "HDF5");
}
OpenedSource openItk(const std::string& path, const OpenOptions& options) {
  if constexpr (ISOBRICK_WITH_ITK) return openItkSource(path, options);
  throw leftOut(path, "ITK");
}

// False for the formats of which every voxel has one value, or which are read no further.
bool mayHaveComponents(const std::string& path, const OpenOptions& options) {
  const std::string ending = lowerExtension(path);
  return !options.raw && !isFolder(path) && !isHdf5Name(path) && ending != ".isb" &&
         ending != ".vdb" && ending != ".xml" && !isRemotePath(path);
}

// All that is known of formats: `knows` checks the name, the kind or the first bytes. The first
// reader that recognises a path reads it; what is left is for ITK, which recognises formats by
// their content.
using enum ReadableFormat::Choice;
struct Reader {
  ReadableFormat format;
  bool (*knows)(const std::string& path, bool is_folder);
  std::unique_ptr<VolumeSource> (*open)(const std::string& path, const OpenOptions& options);
};
template <bool (*isOne)(const std::string& path)>
bool isFile(const std::string& path, bool is_folder) {
  return !is_folder && isRegularFile(path) && isOne(path);
}
template <std::unique_ptr<VolumeSource> (*openOne)(const std::string&, const OpenOptions&)>
std::unique_ptr<VolumeSource> openWith(const std::string& path, const OpenOptions& options) {
  return openOne(path, options);
}
constexpr Reader kReaders[] = {
    {{"OME-Zarr",
      {".ome.zarr", ".zarr", ".ozx"},
      "zipped (.zip)",
      true,
      true,
      kTime | kChannel | kImage},
     [](const std::string& path, bool) { return isZarrFolder(path); },
     openWith<openZarrSource>},
    {{"OpenEXR", {}, "folder of .exr", ISOBRICK_WITH_OPENEXR, false, kGrid | kTime | kChannel},
     [](const std::string& path, bool is_folder) { return is_folder && hasExrSlices(path); },
     openExr},
    {{"HDF5",
      {".h5", ".hdf5", ".h5:/path", ".ims", ".nc"},
      "BigDataViewer's (.xml)",
      ISOBRICK_WITH_HDF5,
      true,
      kTime | kChannel},
     [](const std::string& path, bool is_folder) {
       return !is_folder && (isHdf5Name(path) || lowerExtension(path) == ".xml");
     },
     openHdf5},
    {{"VTK ImageData", {".vti", ".pvti"}, "structured points (.vtk)", true, true, kGrid},
     [](const std::string& path, bool is_folder) {
       const std::string ending = lowerExtension(path);
       return !is_folder && (ending == ".vti" || ending == ".pvti" || ending == ".vtk");
     },
     openWith<openVtiSource>},
    {{"OpenVDB", {".vdb"}, "", ISOBRICK_WITH_OPENVDB, true, kGrid},
     [](const std::string& path, bool is_folder) {
       return !is_folder && lowerExtension(path) == ".vdb";
     },
     openVdb},
    {{"NRRD", {".nrrd", ".nhdr"}, "", true, true, kTime | kChannel},
     isFile<isNrrdFile>,
     openWith<openNrrdSource>},
    {{"MetaImage", {".mhd", ".mha"}, "", true, true, kTime | kChannel},
     isFile<isMetaImageFile>,
     openWith<openMetaImageSource>},
    {{"NIfTI-1, NIfTI-2, Analyze", {".nii", ".nii.gz", ".hdr"}, "", true, true, kTime | kChannel},
     isFile<isNiftiFile>,
     openWith<openNiftiSource>},
    {{"MRC", {".mrc", ".map", ".map.gz"}, "", true, true, kChannel | kImage},
     isFile<isMrcFile>,
     openWith<openMrcSource>},
    {{"DICOM",
      {},
      "file, or folder of a series",
      ISOBRICK_WITH_ITK,
      false,
      kGrid | kTime | kChannel | kSeries},
     nullptr,
     openItk},
    {{"TIFF",
      {".tif", ".tiff"},
      "or folder of slices",
      ISOBRICK_WITH_ITK,
      false,
      kTime | kChannel | kImage},
     nullptr,
     openItk},
    {{"PNG", {}, "folder of slices", ISOBRICK_WITH_ITK, false, kTime | kChannel}, nullptr, openItk},
};

// From a path that refuseUnusablePath() let pass.
std::unique_ptr<VolumeSource> openFormat(const std::string& path, const OpenOptions& options) {
  if (options.raw) return openRawSource(path, *options.raw);
  const bool is_folder = isFolder(path);
  if (options.pyramid_level &&
      (isPyramidFile(path) || (!is_folder && lowerExtension(path) == ".isb")))
    return makePyramidSource(std::make_shared<const Pyramid>(path, options.memory_bytes),
                             options.memory_bytes, *options.pyramid_level, options.cancel);
  for (const Reader& reader : kReaders)
    if (reader.knows != nullptr && reader.knows(path, is_folder)) return reader.open(path, options);
  return openItk(path, options);
}

}  // namespace

std::vector<std::string> gridNames(const std::string& path, const OpenOptions& options) {
  if constexpr (ISOBRICK_WITH_OPENVDB)
    if (!options.raw && !isRemotePath(path) && !isFolder(path) && lowerExtension(path) == ".vdb")
      return vdbGridNames(path, options);
  return {};
}

std::vector<ReadableFormat> readableFormats() {
  std::vector<ReadableFormat> formats;
  for (const Reader& reader : kReaders) formats.push_back(reader.format);
  formats.push_back({"raw voxels", kRawEndings, "", true, false, 0});
  return formats;
}

std::string ReadableFormat::namedBy() const {
  ListText words(" ");
  for (const std::string_view ending : endings)
    if (!ending.empty()) words.add(ending);
  ListText all(", ");
  if (!words.text().empty()) all.add(words.text());
  if (!others.empty()) all.add(others);
  return all.text();
}

std::vector<std::string_view> ReadableFormat::volumeEndings() const {
  std::vector<std::string_view> known;
  if (file_is_volume)
    std::ranges::copy_if(endings, std::back_inserter(known),
                         [](std::string_view ending) { return !ending.empty(); });
  return known;
}

void refuseUnusablePath(const std::string& path, const OpenOptions& options) {
  if (isRemotePath(path) && !isRemoteVolume(path) && (options.raw || !options.pyramid_level))
    throw unreadable(withoutSecrets(path),
                     "of volumes behind a URL isobrick reads OME-Zarr alone, in a folder that is "
                     "named .zarr or ends with '/'; copy other volumes to a file");
  // Opening a pipe would wait for its other end, for ever.
  if (isSpecialFile(path))
    throw unreadable(path, "it is neither a file nor a folder; copy it to a file");
  if (!mayHaveComponents(path, options)) refuseComponentChoice(path, options);
  if (!options.series.empty() && (!isFolder(path) || isZarrFolder(path)))
    throw unreadable(
        path,
        "it is no folder of DICOM series to choose from; name the folder, or leave out the series");
  if (options.raw || isRemotePath(path)) return;
  if (!isRegularFile(path) && !isPyramidFile(path)) return;
  const std::string ending = lowerExtension(path);
  if ((ending == ".isb" || isFolder(path)) && !options.pyramid_level)
    throw fileError(path, "'", path, "' is a pyramid already; give the volume that it was made of");
  if (std::ranges::find(kRawEndings, ending) != kRawEndings.end())
    throw fileError(path, "'", path, "' has no header; say how its voxels lie",
                    Remedy::kDescribeRawFile);
}

std::unique_ptr<VolumeSource> viewAsGiven(std::unique_ptr<VolumeSource> source,
                                          const OpenOptions& options, int level) {
  if (options.spacing || options.origin || !options.unit.empty()) {
    GivenPlace place = options;
    if (place.spacing) *place.spacing *= static_cast<double>(std::int64_t{1} << level);
    source = makePlacedSource(std::move(source), place);
  }
  return derivedVolume(std::move(source), options.derivation);
}

std::unique_ptr<VolumeSource> openVolume(const std::string& path, const OpenOptions& options) {
  refuseUnusablePath(path, options);
  // It is opened again to be read again, when nobody waits for the first of it.
  OpenOptions quiet = options;
  quiet.progress = nullptr;
  auto source = openFormat(path, options);
  if (!takesNumbers(options.derivation) && !(options.keep_numbers && options.derivation.isNone()))
    source = withVoxels(std::move(source), [path, quiet] { return openFormat(path, quiet); });
  return viewAsGiven(std::move(source), options, options.pyramid_level.value_or(0));
}

}  // namespace isobrick
