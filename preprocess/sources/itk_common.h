// The common part of the ITK sources. Private to the files that bear its name: ITK headers go no
// further.
#pragma once

#include <itkImageIOBase.h>

#include <memory>
#include <optional>
#include <string>

#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick::itk_detail {

using Component = itk::ImageIOBase::IOComponentType;

// Registers the formats and silences ITK and GDCM on stderr; once, thread-safe.
void prepareItk();

// One line for a failed call, without ITK's prefixes: "cannot read 'path': reason; what to do".
Error itkError(const std::string& path, const std::exception& exception);

// Opens `path` and reads its header. Throws Error for missing files, unknown formats, damaged
// headers and, unless the options choose one of them, for images with more than one value per
// voxel.
itk::ImageIOBase::Pointer openImage(const std::string& path, const OpenOptions& options = {});

// Voxels per axis; trailing axes of length 1 are dropped, missing ones are 1. Throws Error for
// images with more than one element along further axes than `axes`.
Index3 imageVoxels(const std::string& path, const itk::ImageIOBase& image, unsigned axes = 3);

// Spacing, origin and direction as ITK gives them (LPS for medical formats), not yet tidied.
GridGeometry imageGeometry(const itk::ImageIOBase& image);

// "NRRD", "MetaImage", ...
std::string formatName(const itk::ImageIOBase& image);

// The header of a DICOM image; nothing of files that are no DICOM. Throws Error for DICOM files
// that are damaged or hold no image.
std::optional<DicomHeader> dicomImageHeader(const std::string& path);

// The stored type, and the voxel type if it is one of the five, with exactly the values of a
// component of an image that was opened.
StoredType storedTypeOf(Component component);
std::optional<VoxelType> exactVoxelType(Component component);

// Reads slices [first, first + count) as the image's component type.
void readImageSlices(const std::string& path, itk::ImageIOBase& image, std::int64_t first,
                     std::int64_t count, void* out);

// A single file with a 3-D image.
std::unique_ptr<VolumeSource> openItkFile(const std::string& path, const OpenOptions& options);
// A DICOM file with all slices (frames).
std::unique_ptr<VolumeSource> openDicomFile(const std::string& path, const DicomHeader& header,
                                            const OpenOptions& options);
// A folder with a DICOM series or a stack of slices.
std::unique_ptr<VolumeSource> openItkFolder(const std::string& path, const OpenOptions& options);

// Calls `f(tag)` with the C++ type of a component.
template <typename F>
decltype(auto) visitComponent(Component component, F&& f) {
  switch (component) {
    case Component::UCHAR:
      return f(VoxelTag<std::uint8_t>{});
    case Component::CHAR:
      return f(VoxelTag<std::int8_t>{});
    case Component::USHORT:
      return f(VoxelTag<std::uint16_t>{});
    case Component::SHORT:
      return f(VoxelTag<std::int16_t>{});
    case Component::UINT:
      return f(VoxelTag<std::uint32_t>{});
    case Component::INT:
      return f(VoxelTag<std::int32_t>{});
    case Component::ULONG:
      return f(VoxelTag<unsigned long>{});
    case Component::LONG:
      return f(VoxelTag<long>{});
    case Component::ULONGLONG:
      return f(VoxelTag<unsigned long long>{});
    case Component::LONGLONG:
      return f(VoxelTag<long long>{});
    case Component::FLOAT:
      return f(VoxelTag<float>{});
    case Component::DOUBLE:
      return f(VoxelTag<double>{});
    default:
      throw Error("this kind of voxel is not supported; convert it to a scalar type first");
  }
}

}  // namespace isobrick::itk_detail
