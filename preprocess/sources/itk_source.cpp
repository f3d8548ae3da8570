// Single files that ITK reads.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <new>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_series.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/itk_common.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/tiff_source.h"
#include "isobrick/preprocess/sources/voxel_components.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace itk_detail {
namespace {

VolumeInfo describeVolume(const std::string& path, const itk::ImageIOBase& image,
                          std::vector<std::string> notes) {
  VolumeInfo info;
  info.notes = std::move(notes);
  info.source = path;
  info.format = formatName(image);
  info.voxels = imageVoxels(path, image);
  if (info.voxels.z == 1)
    throw unusable(path, "it is a single 2-D image; name the folder that holds all slices");
  checkVoxelCounts(path, info.voxels);
  info.geometry = imageGeometry(image);
  if (info.format == "DICOM") info.geometry.unit = LengthUnit::kMillimetre;
  tidyGeometry(path, info.geometry, info.voxels, info.notes);
  StoredVoxels stored;
  stored.type = storedTypeOf(image.GetComponentType());
  info.voxel_type = stored.delivered();
  return info;
}

// A 3-D image that cannot be streamed, in one file or behind a header in several: held in memory
// from the first readRows() until the last row was delivered. (ITK could stream some of them, but
// it then does not notice that the data end early.)
class WholeImageSource final : public VolumeSource {
 public:
  WholeImageSource(VolumeInfo info, std::vector<std::string> files, itk::ImageIOBase::Pointer image,
                   const StoredVoxels& stored, const CancelFlag* cancel)
      : info_(std::move(info)),
        files_(std::move(files)),
        image_(std::move(image)),
        stored_(stored),
        cancel_(cancel) {}

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const auto row_voxels = static_cast<std::size_t>(info_.voxels.x);
    try {
      if (!buffer_) load();
    } catch (const std::bad_alloc& exception) {
      throw itkError(info_.source, exception);
    }
    const std::byte* from =
        buffer_.get() + static_cast<std::size_t>(first) * row_voxels * stored_.bytes();
    decodeVoxels(stored_, static_cast<std::size_t>(count) * row_voxels, out,
                 [&](std::byte* to, std::size_t bytes) {
                   std::memcpy(to, from, bytes);
                   from += bytes;
                 });
    if (first + count == info_.voxels.y * info_.voxels.z) buffer_.reset();
  }

  std::vector<std::string> files() const override { return files_; }
  std::uint64_t bufferBytes() const override {
    return stored_.bytesOf(elementCount(info_.voxels))
        .value_or(std::numeric_limits<std::uint64_t>::max());
  }

 private:
  // The whole image into buffer_.
  void load() {
    const std::uint64_t bytes = bufferBytes();
    // Otherwise the kernel alone would refuse more than the machine has, or not even that.
    const auto physical = static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) *
                          static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
    if (bytes > physical) throw std::bad_alloc();
    // ITK reads the image in one call, which may take minutes.
    buffer_ = runAbandonable(cancel_,
                             [path = info_.source, image = image_, slices = info_.voxels.z, bytes] {
                               std::shared_ptr<std::byte[]> whole(new std::byte[bytes]);
                               readImageSlices(path, *image, 0, slices, whole.get());
                               return whole;
                             });
  }

  VolumeInfo info_;
  std::vector<std::string> files_;
  itk::ImageIOBase::Pointer image_;
  StoredVoxels stored_;
  const CancelFlag* cancel_;
  std::shared_ptr<std::byte[]> buffer_;
};

std::unique_ptr<VolumeSource> openImageFile(const std::string& path, std::vector<std::string> files,
                                            itk::ImageIOBase::Pointer image,
                                            const OpenOptions& options,
                                            std::vector<std::string> notes = {}) {
  VolumeInfo info = describeVolume(path, *image, std::move(notes));
  const auto components = static_cast<std::uint64_t>(image->GetNumberOfComponents());
  StoredVoxels stored;
  stored.type = storedTypeOf(image->GetComponentType());
  takeComponent(components, options, stored, info);
  return std::make_unique<WholeImageSource>(std::move(info), std::move(files), std::move(image),
                                            stored, options.cancel);
}

}  // namespace

std::unique_ptr<VolumeSource> openItkFile(const std::string& path, const OpenOptions& options) {
  static_cast<void>(InputFile(path));  // refuses a pipe, which ITK would wait for
  if (const auto header = dicomImageHeader(path)) return openDicomFile(path, *header, options);
  if (auto pages = openTiffFile(path, options)) return pages;
  return openImageFile(path, {path}, openImage(path, options), options);
}

}  // namespace itk_detail

std::unique_ptr<VolumeSource> openItkSource(const std::string& path, const OpenOptions& options) {
  const bool is_medium = !isFolder(path) && isDicomDirectory(path);
  if (!isFolder(path) && !is_medium) return itk_detail::openItkFile(path, options);
  refuseComponentChoice(path, options);
  try {
    const std::size_t name = path.rfind('/');
    return itk_detail::openItkFolder(!is_medium                  ? path
                                     : name == std::string::npos ? "."
                                                                 : path.substr(0, name + 1),
                                     options);
  } catch (const Error& error) {
    const std::vector<Remedy>& remedies = error.remedies();
    if (std::find(remedies.begin(), remedies.end(), Remedy::kChooseComponent) == remedies.end())
      throw;
    throw Error(
        "cannot use '" + path + "': its slices have several values per voxel, and of " +
            "slices none can be chosen; convert them to grey ones, or to a single file of " +
            "several pages",
        {.path = error.place().path});
  }
}

}  // namespace isobrick
