#include "isobrick/preprocess/sources/open_volume.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <string_view>

#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/exr_source.h"
#include "isobrick/preprocess/sources/hdf5_source.h"
#include "isobrick/preprocess/sources/header_text.h"
#include "isobrick/preprocess/sources/itk_source.h"
#include "isobrick/preprocess/sources/pyramid_source.h"
#include "isobrick/preprocess/sources/raw_source.h"
#include "isobrick/preprocess/sources/vdb_source.h"
#include "isobrick/preprocess/sources/voxel_components.h"
#include "isobrick/preprocess/sources/vti_source.h"
#include "isobrick/preprocess/sources/zarr_source.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// Endings of files that have no header.
constexpr std::array<std::string_view, 8> kRawEndings = {".raw", ".bin", ".dat", ".vol",
                                                         ".u8",  ".u16", ".i16", ".f32"};

[[maybe_unused]] Error leftOut(const std::string& path, const char* library) {
  return unreadable(path,
                    std::string("this isobrick was built without ") + library +
                        "; build it anew with that, or convert the file to .vti or raw voxels");
}

std::unique_ptr<VolumeSource> openVdb(const std::string& path,
                                      [[maybe_unused]] const OpenOptions& options) {
#if ISOBRICK_WITH_OPENVDB
  return openVdbSource(path, options);
#else
  throw leftOut(path, "OpenVDB");
#endif
}

std::unique_ptr<VolumeSource> openExr(const std::string& path,
                                      [[maybe_unused]] const OpenOptions& options) {
#if ISOBRICK_WITH_OPENEXR
  return openExrSlices(path, options);
#else
  throw leftOut(path, "OpenEXR");
#endif
}

std::unique_ptr<VolumeSource> openHdf5(const std::string& path,
                                       [[maybe_unused]] const OpenOptions& options) {
#if ISOBRICK_WITH_HDF5
  return openHdf5Source(path, options);
#else
  throw leftOut(path, "HDF5");
#endif
}

std::unique_ptr<VolumeSource> openItk(const std::string& path,
                                      [[maybe_unused]] const OpenOptions& options) {
#if ISOBRICK_WITH_ITK
  return openItkSource(path, options);
#else
  throw leftOut(path, "ITK");
#endif
}

// False for the formats of which every voxel has one value, or which are read no further.
bool mayHaveComponents(const std::string& path, const OpenOptions& options) {
  std::error_code ignored;
  const std::string ending = lowerExtension(path);
  return !options.raw && !fs::is_directory(path, ignored) && !isHdf5Name(path) &&
         ending != ".isb" && ending != ".vdb";
}

// From a path that refuseUnusablePath() let pass.
std::unique_ptr<VolumeSource> openFormat(const std::string& path, const OpenOptions& options) {
  if (options.raw) return openRawSource(path, *options.raw);
  std::error_code ignored;
  if (fs::is_directory(path, ignored) && isZarrFolder(path)) return openZarrSource(path, options);
  if (fs::is_directory(path, ignored) && hasExrSlices(path)) return openExr(path, options);
  if (!fs::is_directory(path, ignored) && isHdf5Name(path)) return openHdf5(path, options);
  if (!fs::is_directory(path, ignored)) {
    const std::string ending = lowerExtension(path);
    if (ending == ".isb" && options.pyramid_level)
      return makePyramidSource(std::make_shared<const Pyramid>(path, options.memory_bytes),
                               options.memory_bytes, *options.pyramid_level, options.cancel);
    if (ending == ".vti") return openVtiSource(path, options);
    if (ending == ".vdb") return openVdb(path, options);
  }
  return openItk(path, options);
}

}  // namespace

void refuseUnusablePath(const std::string& path, const OpenOptions& options) {
  std::error_code ignored;
  const fs::file_status status = fs::status(path, ignored);
  // Opening a pipe would wait for its other end, for ever.
  if (fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status))
    throw unreadable(path, "it is neither a file nor a folder; copy it to a file");
  if (!mayHaveComponents(path, options)) refuseComponentChoice(path, options);
  if (!options.series.empty() && (!fs::is_directory(status) || isZarrFolder(path)))
    throw unreadable(
        path,
        "it is no folder of DICOM series to choose from; name the folder, or leave out the series");
  if (options.raw || !fs::is_regular_file(status)) return;
  const std::string ending = lowerExtension(path);
  if (ending == ".isb" && !options.pyramid_level)
    throw Error("'" + path + "' is a pyramid already; give the volume that it was made of",
                {.path = path});
  if (std::find(kRawEndings.begin(), kRawEndings.end(), ending) != kRawEndings.end())
    throw Error("'" + path + "' has no header; say how its voxels lie", {.path = path},
                {Remedy::kDescribeRawFile});
}

std::unique_ptr<VolumeSource> placedAsGiven(std::unique_ptr<VolumeSource> source,
                                            const OpenOptions& options, int level) {
  if (!options.spacing && !options.origin) return source;
  std::optional<glm::dvec3> spacing = options.spacing;
  if (spacing) *spacing *= static_cast<double>(std::int64_t{1} << level);
  return makePlacedSource(std::move(source), spacing, options.origin);
}

std::unique_ptr<VolumeSource> openVolume(const std::string& path, const OpenOptions& options) {
  refuseUnusablePath(path, options);
  return placedAsGiven(openFormat(path, options), options, options.pyramid_level.value_or(0));
}

}  // namespace isobrick
