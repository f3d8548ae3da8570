// What ITK reads, slices of PNG, and the way to DICOM and TIFF: single files and folders of slices.
#include <itkImageIOBase.h>
#include <itkImageIOFactory.h>
#include <itkPNGImageIOFactory.h>

#include <algorithm>
#include <cstring>
#include <mutex>
#include <new>
#include <set>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_source.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/slice_names.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// ITK's messages carry addresses, class names and line breaks.
std::string plainMessage(std::string text) {
  for (char& c : text)
    if (c == '\n' || c == '\r' || c == '\t') c = ' ';
  // "ITK ERROR: NrrdImageIO(0x55d0c0): reason"
  if (const std::size_t end = text.find("): ");
      end != std::string::npos && text.find("ERROR") < end)
    text.erase(0, end + 3);
  std::string line;
  for (const char c : text)
    if (c != ' ' || (!line.empty() && line.back() != ' ')) line += c;
  while (!line.empty() && (line.back() == ' ' || line.back() == '.' || line.back() == '!'))
    line.pop_back();
  constexpr std::size_t kMostCharacters = 300;
  if (line.size() > kMostCharacters) line = line.substr(0, kMostCharacters) + "...";
  return line;
}

// One line for a failed call.
Error itkError(const std::string& path, const std::exception& exception) {
  if (dynamic_cast<const std::bad_alloc*>(&exception) != nullptr)
    return unreadable(path,
                      "not enough memory for its voxels; check the dimensions in its header, or "
                      "convert it to .mhd or .nrrd, which are read piece by piece");
  const auto* itk_exception = dynamic_cast<const itk::ExceptionObject*>(&exception);
  return unreadable(
      path,
      plainMessage(itk_exception != nullptr ? itk_exception->GetDescription() : exception.what()),
      "; check that the file is whole and not damaged");
}

Error unknownFormat(const std::string& path) {
  static constexpr std::pair<const char*, const char*> kConverters[] = {
      {".gipl", "save it as .nrrd with 3D Slicer"},
      {".gipl.gz", "save it as .nrrd with 3D Slicer"},
      {".pic", "save it as .tif with Fiji"},
      {".zip", "unpack it and name the folder"}};
  for (const auto& [ending, advice] : kConverters)
    if (lowercase(path).ends_with(ending))
      return unusable(path, "this format is not read; ", advice);
  return unreadable(path,
                    "it is unreadable or in no known format (NRRD, MetaImage, NIfTI, TIFF, DICOM, "
                    "MRC, VTI, ...); say its layout if it has no header",
                    Remedy::kDescribeRawFile);
}

// Opens `path` and reads its header. Throws Error for missing files, unknown formats, damaged
// headers and, unless the options choose one of them, for images with several values per voxel.
itk::ImageIOBase::Pointer openImage(const std::string& path, const OpenOptions& options = {}) {
  static std::once_flag once;
  std::call_once(once, [] {
    itk::Object::GlobalWarningDisplayOff();
    itk::ObjectFactoryBase::RegisterFactory(itk::PNGImageIOFactory::New());
  });
  static_cast<void>(InputFile(path));  // says why it cannot be opened
  itk::ImageIOBase::Pointer image;
  try {
    image = itk::ImageIOFactory::CreateImageIO(path.c_str(), itk::IOFileModeEnum::ReadMode);
    if (image.IsNotNull()) {
      image->SetFileName(path);
      image->ReadImageInformation();
    }
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
  if (image.IsNull()) throw unknownFormat(path);
  checkComponentChoice(path, image->GetNumberOfComponents(), options);
  return image;
}

// Of one slice, with so many pixels as `expected`; 0: any.
itk::ImageIOBase::Pointer openSlice(const std::string& path, const Index3& expected) {
  const itk::ImageIOBase::Pointer image = openImage(path);
  const Index3 pixels(static_cast<std::int64_t>(image->GetDimensions(0)),
                      static_cast<std::int64_t>(image->GetDimensions(1)), 1);
  if (expected.x != 0 && (pixels.x != expected.x || pixels.y != expected.y))
    throw unusable(path, "it has ", pixels.x, " x ", pixels.y, " pixels and the first slice ",
                   expected.x, " x ", expected.y,
                   "; keep only the slices of one volume in the folder");
  return image;
}

VoxelType typeOf(const itk::ImageIOBase& image) {  // PNG has no others
  const bool is_wide = image.GetComponentType() == itk::ImageIOBase::IOComponentType::USHORT;
  return is_wide ? VoxelType::kUint16 : VoxelType::kUint8;
}

using SliceBytes = std::shared_ptr<std::vector<std::byte>>;

// The pixels of slice k as `type`: nothing is cut off. Into `buffer`, that of an earlier slice.
SliceBytes decodeSlice(const std::string& path, std::int64_t k, const Index3& expected,
                       VoxelType type, SliceBytes buffer) {
  const itk::ImageIOBase::Pointer image = openSlice(path, expected);
  buffer->resize(static_cast<std::size_t>(image->GetImageSizeInBytes()));
  itk::ImageIORegion region(image->GetNumberOfDimensions());
  for (unsigned axis = 0; axis < image->GetNumberOfDimensions(); ++axis)
    region.SetSize(axis, image->GetDimensions(axis));
  try {
    image->SetIORegion(region);
    image->Read(buffer->data());
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
  if (typeOf(*image) == type) return buffer;
  const std::int64_t pixels = expected.x * expected.y;
  const auto converted =
      std::make_shared<std::vector<std::byte>>(static_cast<std::size_t>(pixels) * voxelBytes(type));
  if (type == VoxelType::kUint16) {
    const auto* const from = reinterpret_cast<const std::uint8_t*>(buffer->data());
    std::copy(from, from + pixels, reinterpret_cast<std::uint16_t*>(converted->data()));
    return converted;
  }
  const auto* const from = reinterpret_cast<const std::uint16_t*>(buffer->data());
  for (std::int64_t i = 0; i < pixels; ++i) {
    if (from[i] > 255)
      throw fileError(path, "cannot read slice ", k, ", '", path, "': its value ", from[i],
                      " does not fit the ", voxelTypeName(type),
                      " of the first slice; convert all to one type");
    (*converted)[static_cast<std::size_t>(i)] = static_cast<std::byte>(from[i]);
  }
  return converted;
}

// One slice is held.
class SliceStackSource final : public VolumeSource {
 public:
  // `slice_bytes`: of a slice as it is stored.
  SliceStackSource(VolumeInfo info, std::vector<std::string> files, std::uint64_t slice_bytes,
                   const CancelFlag* cancel)
      : info_(std::move(info)),
        files_(std::move(files)),
        slice_bytes_(slice_bytes),
        cancel_(cancel) {}

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const std::size_t row_bytes =
        static_cast<std::size_t>(info_.voxels.x) * voxelBytes(info_.voxel_type);
    forEachSliceOfRows(info_, first, count, out,
                       [&](std::int64_t k, std::int64_t y, std::int64_t rows, std::byte* to) {
                         if (k != slice_) loadSlice(k);
                         std::memcpy(to, pixels_->data() + static_cast<std::size_t>(y) * row_bytes,
                                     static_cast<std::size_t>(rows) * row_bytes);
                       });
  }

  std::vector<std::string> files() const override { return files_; }
  // ITK's libraries hold the slice too while they decode it, and once more if they rescale it.
  std::uint64_t bufferBytes() const override { return 3 * slice_bytes_; }

 private:
  void loadSlice(std::int64_t k) {
    slice_ = -1;
    auto buffer = pixels_ ? std::move(pixels_) : std::make_shared<std::vector<std::byte>>();
    // A large packed slice takes seconds, and its library does not stop before its end.
    pixels_ = runAbandonable(
        cancel_, [file = files_[static_cast<std::size_t>(k)], k, expected = info_.voxels,
                  type = info_.voxel_type, buffer = std::move(buffer)] {
          return decodeSlice(file, k, expected, type, buffer);
        });
    slice_ = k;
  }

  VolumeInfo info_;
  std::vector<std::string> files_;
  std::uint64_t slice_bytes_;
  const CancelFlag* cancel_;
  std::int64_t slice_ = -1;  // the one in pixels_; none is -1
  SliceBytes pixels_;
};

std::vector<std::string> withExtension(const std::vector<std::string>& files,
                                       const std::set<std::string>& extensions) {
  std::vector<std::string> result;
  for (const std::string& file : files)
    if (extensions.contains(lowerExtension(file))) result.push_back(file);
  std::ranges::sort(result, numericNameLess);
  return result;
}

std::unique_ptr<VolumeSource> openImageFile(const std::string& path, const OpenOptions& options) {
  static_cast<void>(InputFile(path));  // refuses a pipe, which ITK would wait for
  if (const auto header = dicomImageHeader(path)) return openDicomFile(path, *header, options);
  if (auto pages = openTiffFile(path, options)) return pages;
  openImage(path, options);
  throw unusable(path, "it is a single 2-D image; name the folder that holds all slices");
}

std::unique_ptr<VolumeSource> openImageStack(const std::string& folder,
                                             const std::vector<std::string>& files,
                                             const OpenOptions& options,
                                             std::vector<std::string> notes) {
  if (!options.series.empty())
    throw fileError(folder, "cannot use the folder '", folder,
                    "': it holds no DICOM series to choose from");
  if (files.size() == 1) return openImageFile(files.front(), options);
  VolumeInfo info;
  info.source = folder;
  info.notes = std::move(notes);
  if (lowerExtension(files.front()) != ".png")
    return openTiffStack(std::move(info), files, options);
  const std::vector<std::string> paths = chooseSlices(files, options, info);
  const itk::ImageIOBase::Pointer first = openSlice(paths.front(), Index3(0));
  info.format = "PNG stack";
  info.voxels = {static_cast<std::int64_t>(first->GetDimensions(0)),
                 static_cast<std::int64_t>(first->GetDimensions(1)), std::ssize(paths)};
  checkVoxelCounts(folder, info.voxels);
  info.geometry.spacing = {first->GetSpacing(0), first->GetSpacing(1), 1};
  info.geometry.spacing.z = info.geometry.spacing.x;
  if (!options.spacing) info.notes.emplace_back(kNoSliceDistance);
  tidyGeometry(folder, info.geometry, info.voxels, info.notes);
  info.voxel_type = typeOf(*first);
  return std::make_unique<SliceStackSource>(std::move(info), paths, first->GetImageSizeInBytes(),
                                            options.cancel);
}

// A way to read a folder, and how many slices speak for it.
struct FolderKind {
  const char* name;
  std::int64_t slices;
};

// The kind with the most slices: a stray picture does not decide. A note names the others.
std::size_t mostOf(const std::string& folder, const std::vector<FolderKind>& kinds,
                   std::vector<std::string>& notes) {
  std::size_t most = 0;
  for (std::size_t i = 1; i < kinds.size(); ++i)
    if (kinds[i].slices > kinds[most].slices) most = i;
  if (kinds[most].slices == 0)
    throw fileError(folder, "cannot read the folder '", folder,
                    "': it holds neither DICOM files nor TIFF or PNG slices; name a folder that "
                    "does, or a file");
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    if (i == most || kinds[i].slices == 0) continue;
    const auto counted = [](const FolderKind& kind) {
      return concat(kind.slices, " ", kind.name, kind.slices == 1 ? " slice" : " slices");
    };
    if (kinds[i].slices == kinds[most].slices)
      throw fileError(folder, "cannot use the folder '", folder, "': it holds ",
                      counted(kinds[most]), " and ", counted(kinds[i]),
                      "; move one of them to a folder of its own");
    notes.push_back(counted(kinds[i]) + " in the folder " +
                    (kinds[i].slices == 1 ? "was" : "were") + " left out");
  }
  return most;
}

std::unique_ptr<VolumeSource> openImageFolder(const std::string& path, const OpenOptions& options) {
  std::vector<std::string> files = filesInFolder(path);
  // Names of slice images are no DICOM and may be large: do not scan them.
  const std::vector<std::string> tiffs = withExtension(files, {".tif", ".tiff"});
  const std::vector<std::string> images = withExtension(files, {".png"});
  std::erase_if(files, [&](const std::string& file) {
    return !withExtension({file}, {".tif", ".tiff", ".png"}).empty();
  });
  DicomScan dicom = scanDicom(files, options);
  // A medium keeps its series in folders below, and a list of them here.
  const bool is_medium = std::ranges::any_of(files, isDicomDirectory);
  if (dicom.pictures() == 0 && (is_medium || (tiffs.empty() && images.empty())))
    dicom = scanDicom(filesBelowFolder(path), options);
  std::vector<std::string> notes;
  switch (mostOf(path,
                 {{"DICOM", dicom.pictures()},
                  {"TIFF", static_cast<std::int64_t>(tiffs.size())},
                  {"PNG", static_cast<std::int64_t>(images.size())}},
                 notes)) {
    case 0:
      return openDicomSeries(path, std::move(dicom), options, std::move(notes));
    case 1:
      return openImageStack(path, tiffs, options, std::move(notes));
    default:
      return openImageStack(path, images, options, std::move(notes));
  }
}

}  // namespace

std::unique_ptr<VolumeSource> openItkSource(const std::string& path, const OpenOptions& options) {
  const bool is_medium = !isFolder(path) && isDicomDirectory(path);
  if (!isFolder(path) && !is_medium) return openImageFile(path, options);
  refuseComponentChoice(path, options);
  try {
    const std::size_t name = path.rfind('/');
    return openImageFolder(!is_medium                  ? path
                           : name == std::string::npos ? "."
                                                       : path.substr(0, name + 1),
                           options);
  } catch (const Error& error) {
    const std::vector<Remedy>& remedies = error.remedies();
    if (std::ranges::find(remedies, Remedy::kChooseComponent) == remedies.end()) throw;
    throw fileError(error.place().path, "cannot use '", path,
                    "': its slices have several values per voxel, and of slices none can be "
                    "chosen; convert them to grey ones, or to a single file of several pages");
  }
}

}  // namespace isobrick
