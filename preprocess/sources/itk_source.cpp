// Single files that ITK reads, and code that the folder source shares.
#include <dlfcn.h>
#include <itkGDCMImageIO.h>
#include <itkImageIOFactory.h>
#include <itkMRCImageIOFactory.h>
#include <itkMetaImageIOFactory.h>
#include <itkNiftiImageIOFactory.h>
#include <itkNrrdImageIOFactory.h>
#include <itkPNGImageIOFactory.h>
#include <itkTIFFImageIO.h>
#include <itkTIFFImageIOFactory.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <limits>
#include <map>
#include <mutex>
#include <new>
#include <sstream>

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/dicom_stack.h"
#include "isobrick/preprocess/sources/dicom_tags.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/header_text.h"
#include "isobrick/preprocess/sources/itk_common.h"
#include "isobrick/preprocess/sources/length_units.h"
#include "isobrick/preprocess/sources/nifti_run.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/tiff_pages.h"
#include "isobrick/preprocess/sources/tiff_source.h"
#include "isobrick/preprocess/sources/voxel_components.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace itk_detail {
namespace {

// Without ITK's CMake "use file" nothing is registered; and a factory that was registered twice
// would only be called twice.
template <typename... Factories>
void registerFactories() {
  (itk::ObjectFactoryBase::RegisterFactory(Factories::New()), ...);
}

// ITK's messages carry addresses, class names and line breaks.
std::string plainMessage(std::string text) {
  for (char& c : text)
    if (c == '\n' || c == '\r' || c == '\t') c = ' ';
  // NRRD's are a chain of callers; the last one gives the reason: "... [nrrd] function: reason"
  if (const std::size_t last = text.rfind("[nrrd] "); last != std::string::npos) {
    text.erase(0, last + 7);
    if (const std::size_t end = text.find(": "); end != std::string::npos) text.erase(0, end + 2);
  }
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

// Catches the output of a library on std::cerr while it lives: MetaIO reports some errors only
// there, and the user gets one line for an error. One at a time in the process; another thread's
// std::cerr meanwhile is caught too.
class CerrCapture {
 public:
  CerrCapture() : lock_(mutex()), previous_(std::cerr.rdbuf(text_.rdbuf())) {}
  ~CerrCapture() { std::cerr.rdbuf(previous_); }
  CerrCapture(const CerrCapture&) = delete;
  CerrCapture& operator=(const CerrCapture&) = delete;
  std::string text() const { return text_.str(); }

 private:
  static std::mutex& mutex() {
    static std::mutex the_mutex;
    return the_mutex;
  }
  std::lock_guard<std::mutex> lock_;
  std::ostringstream text_;
  std::streambuf* previous_;
};

std::string formatName(const itk::ImageIOBase& image) {
  static const std::map<std::string, std::string> kNames = {{"NrrdImageIO", "NRRD"},
                                                            {"MetaImageIO", "MetaImage"},
                                                            {"NiftiImageIO", "NIfTI"},
                                                            {"GDCMImageIO", "DICOM"}};
  const std::string name = image.GetNameOfClass();
  if (const auto known = kNames.find(name); known != kNames.end()) return known->second;
  return name.substr(0, name.find("ImageIO"));
}

// Nothing of files that are no DICOM. Throws Error for DICOM files that are damaged or hold no
// image.
std::optional<DicomHeader> dicomImageHeader(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) return std::nullopt;
  DicomHeader header = readDicomHeader(path);
  switch (header.state) {
    case DicomHeader::State::kNotDicom:
      return std::nullopt;
    case DicomHeader::State::kNoImage:
      throw unusable(path, "it is a DICOM file without an image; name the folder of the series");
    case DicomHeader::State::kDamaged:
      throw unreadable(path, "the DICOM file is cut short or damaged; get the whole file again");
    case DicomHeader::State::kImage:
      break;
  }
  return header;
}

// libtiff prints on the C stream. ITK's copy of it has renamed functions and no header.
void silenceTiff() {
  using Handler = void (*)(const char*, const char*, std::va_list);
  using SetHandler = Handler (*)(Handler);
  for (const char* name : {"itk_TIFFSetErrorHandler", "itk_TIFFSetWarningHandler",
                           "TIFFSetErrorHandler", "TIFFSetWarningHandler"})
    if (void* const function = dlsym(RTLD_DEFAULT, name))
      reinterpret_cast<SetHandler>(function)(nullptr);
}

}  // namespace

void prepareItk() {
  static std::once_flag once;
  std::call_once(once, [] {
    itk::Object::GlobalWarningDisplayOff();
    silenceTiff();
    // DICOM is not among them: openImage() reads such files itself (dicom_header.h).
    registerFactories<itk::NrrdImageIOFactory, itk::MetaImageIOFactory, itk::NiftiImageIOFactory,
                      itk::TIFFImageIOFactory, itk::PNGImageIOFactory, itk::MRCImageIOFactory>();
  });
}

Error itkError(const std::string& path, const std::exception& exception) {
  if (dynamic_cast<const std::bad_alloc*>(&exception) != nullptr)
    return unreadable(path,
                      "not enough memory for its voxels; check the dimensions in its header, or "
                      "convert it to .mhd or .nrrd, which are read piece by piece");
  const auto* itk_exception = dynamic_cast<const itk::ExceptionObject*>(&exception);
  return unreadable(path, plainMessage(itk_exception != nullptr ? itk_exception->GetDescription()
                                                                : exception.what()) +
                              "; check that the file is whole and not damaged");
}

namespace {

// Reads the header of `image`, which may be null: no known format.
itk::ImageIOBase::Pointer withInformation(const std::string& path,
                                          itk::ImageIOBase::Pointer image) {
  if (image.IsNotNull()) {
    image->SetFileName(path);
    image->ReadImageInformation();
  }
  return image;
}

Error unknownFormat(const std::string& path) {
  static constexpr std::pair<const char*, const char*> kConverters[] = {
      {".vtk", "save it as .vti with ParaView"},
      {".gipl", "save it as .nrrd with 3D Slicer"},
      {".gipl.gz", "save it as .nrrd with 3D Slicer"},
      {".pic", "save it as .tif with Fiji"}};
  for (const auto& [ending, advice] : kConverters)
    if (lowercase(path).ends_with(ending))
      return unusable(path, std::string("this format is not read; ") + advice);
  return unreadable(path,
                    "it is unreadable or in no known format (NRRD, MetaImage, NIfTI, TIFF, DICOM, "
                    "MRC, VTI, ...); say its layout if it has no header",
                    {Remedy::kDescribeRawFile});
}

// The stored type with exactly this component's values, or none.
std::optional<StoredType> storedTypeOf(Component component) {
  return visitComponent(component, [](auto tag) -> std::optional<StoredType> {
    using T = typename decltype(tag)::Type;
    return isobrick::storedTypeOf(std::is_floating_point_v<T> ? 'f'
                                  : std::is_signed_v<T>       ? 'i'
                                                              : 'u',
                                  sizeof(T));
  });
}

// `options` decide about several values per voxel.
itk::ImageIOBase::Pointer requireImage(const std::string& path, itk::ImageIOBase::Pointer image,
                                       const OpenOptions& options) {
  if (image.IsNull()) throw unknownFormat(path);
  const Component component = image->GetComponentType();
  if (component == Component::UNKNOWNCOMPONENTTYPE || component == Component::LDOUBLE)
    throw unusable(path, "this kind of voxel is not supported; convert it to a scalar type first");
  if (dynamic_cast<const itk::TIFFImageIO*>(image.GetPointer()) != nullptr)
    refuseMisreadTiff(path, storedTypeOf(component));
  checkComponentChoice(path, image->GetNumberOfComponents(), options);
  return image;
}

}  // namespace

itk::ImageIOBase::Pointer openImage(const std::string& path, const OpenOptions& options) {
  prepareItk();
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status))
    throw Error("cannot open '" + path + "': " +
                    (error ? error.message() : "No such file or directory") + "; check the path",
                {.path = path});
  checkNiftiHeader(path);
  itk::ImageIOBase::Pointer image;
  try {
    const CerrCapture silence;
    if (dicomImageHeader(path))
      image = itk::GDCMImageIO::New().GetPointer();
    else
      image = itk::ImageIOFactory::CreateImageIO(path.c_str(), itk::IOFileModeEnum::ReadMode);
    image = withInformation(path, image);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
  return requireImage(path, image, options);
}

itk::ImageIOBase::Pointer openDicomImage(const std::string& path, const FileStamp& stamp,
                                         const OpenOptions& options) {
  prepareItk();
  if (fileStamp(path) != stamp)
    throw unreadable(path,
                     "it changed since its header was read; run again when nobody writes to it");
  try {
    const CerrCapture silence;
    return requireImage(path, withInformation(path, itk::GDCMImageIO::New().GetPointer()), options);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
}

Index3 imageVoxels(const std::string& path, const itk::ImageIOBase& image, unsigned axes) {
  Index3 voxels(1);
  for (unsigned axis = 0; axis < image.GetNumberOfDimensions(); ++axis) {
    const auto count = image.GetDimensions(axis);
    if (axis >= axes && count != 1)
      throw unusable(path, "it has " + std::to_string(count) +
                               " time steps or channels; extract one 3-D volume first");
    // Hostile headers: more than 63 bits would look negative, which checkVoxelCounts refuses too.
    if (axis < 3) voxels[static_cast<int>(axis)] = static_cast<std::int64_t>(count);
  }
  return voxels;
}

GridGeometry imageGeometry(const itk::ImageIOBase& image) {
  GridGeometry geometry;
  const unsigned axes = std::min(image.GetNumberOfDimensions(), 3u);
  for (unsigned axis = 0; axis < axes; ++axis) {
    const int i = static_cast<int>(axis);
    geometry.spacing[i] = image.GetSpacing(axis);
    geometry.origin[i] = image.GetOrigin(axis);
    const std::vector<double> direction = image.GetDirection(axis);
    for (unsigned row = 0; row < std::min<std::size_t>(direction.size(), 3); ++row)
      geometry.direction[i][static_cast<int>(row)] = direction[row];
  }
  return geometry;
}

std::optional<VoxelType> exactVoxelType(Component component) {
  switch (component) {
    case Component::UCHAR:
      return VoxelType::kUint8;
    case Component::CHAR:
      return VoxelType::kInt8;
    case Component::USHORT:
      return VoxelType::kUint16;
    case Component::SHORT:
      return VoxelType::kInt16;
    case Component::FLOAT:
      return VoxelType::kFloat32;
    default:
      return std::nullopt;
  }
}

void readImageSlices(const std::string& path, itk::ImageIOBase& image, std::int64_t first,
                     std::int64_t count, void* out) {
  const unsigned axes = image.GetNumberOfDimensions();
  itk::ImageIORegion region(axes);
  for (unsigned axis = 0; axis < axes; ++axis) {
    region.SetIndex(axis, axis == 2 ? first : 0);
    region.SetSize(axis,
                   axis == 2 ? static_cast<itk::SizeValueType>(count) : image.GetDimensions(axis));
  }
  try {
    const CerrCapture printed;
    image.SetIORegion(region);
    image.Read(out);
    // Data that are cut short or do not inflate are only printed.
    if (formatName(image) == "MetaImage" && !printed.text().empty())
      throw std::runtime_error(printed.text());
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
}

void convertComponents(Component component, const void* in, std::size_t count, VoxelType type,
                       void* out) {
  visitComponent(component, [&](auto in_tag) {
    using In = typename decltype(in_tag)::Type;
    visitVoxelType(type, [&](auto out_tag) {
      using Out = typename decltype(out_tag)::Type;
      if constexpr (std::is_same_v<In, Out>) {
        std::memcpy(out, in, count * sizeof(Out));
      } else {
        const In* const from = static_cast<const In*>(in);
        Out* const to = static_cast<Out*>(out);
        for (std::size_t i = 0; i < count; ++i) to[i] = static_cast<Out>(from[i]);
      }
    });
  });
}

namespace {

// ITK does not notice if an MRC file ends before its voxels do. In front of them are 1024 bytes and
// an extension, whose length is in the byte order of the machine stamp.
void checkMrcBytes(const std::string& path, std::uint64_t voxel_bytes) {
  constexpr std::size_t kHeaderBytes = 1024, kExtensionAt = 92, kStampAt = 212;
  const InputFile file(path);
  std::array<char, kHeaderBytes> header = {};
  static_cast<void>(file.readAt(0, header.data(), header.size()));
  const std::uint64_t before =
      kHeaderBytes + loadNumber<std::uint32_t>(&header[kExtensionAt], header[kStampAt] == 0x11);
  if (file.size() < before || file.size() - before < voxel_bytes)
    throw unreadable(path, "it has " + std::to_string(file.size()) +
                               " bytes, and its header takes " + std::to_string(before) +
                               " and its voxels " + std::to_string(voxel_bytes) +
                               "; get the whole file again");
}

// MRC's lengths are ångströms; without any ITK makes them 1.
std::string mrcUnit(const std::string& path) {
  constexpr std::size_t kCellAt = 40, kCellBytes = 12;
  std::array<char, kCellBytes> cell = {};
  const InputFile file(path);
  static_cast<void>(file.readAt(kCellAt, cell.data(), cell.size()));
  return cell == std::array<char, kCellBytes>{} ? "" : "angstrom";
}

// The units of the lengths that ITK gives.
void takeUnits(const std::string& path, VolumeInfo& info) {
  const auto take = [&](const std::string& unit) {
    takeLengthUnits({unit, unit, unit}, info.geometry, info.notes);
  };
  if (info.format == "NRRD") takeLengthUnits(nrrdUnits(path), info.geometry, info.notes);
  if (info.format == "MetaImage") take(metaImageUnit(path));
  if (info.format == "TIFF") takeTiffLengths(path, info.geometry, info.notes);
  if (info.format == "DICOM") take("millimeter");
  if (info.format == "MRC") take(mrcUnit(path));
}

// The frames of a dose grid, in mm along its normal.
void checkFrameOffsets(const std::string& path, const std::string& text) {
  const auto count = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\\')) + 1;
  const std::vector<double> offsets = decimalStrings(text, count);
  const double mean = offsets.size() < 2 ? 0
                                         : (offsets.back() - offsets.front()) /
                                               static_cast<double>(offsets.size() - 1);
  bool is_even = mean != 0;
  for (std::size_t i = 1; is_even && i < offsets.size(); ++i)
    is_even = std::abs(offsets[i] - offsets[i - 1] - mean) <= 0.01 * std::abs(mean);
  if (!is_even) throw unusable(path, "its frames are not at even distances; resample it first");
}

VolumeInfo describeVolume(const std::string& path, const itk::ImageIOBase& image,
                          std::vector<std::string> notes) {
  VolumeInfo info;
  info.notes = std::move(notes);
  info.source = path;
  info.format = formatName(image);
  // NIfTI's fourth axis is time; one step of it is taken.
  info.voxels = imageVoxels(path, image, info.format == "NIfTI" ? 4 : 3);
  if (info.voxels.z == 1)
    throw unusable(path, "it is a single 2-D image; name the folder that holds all slices");
  checkVoxelCounts(path, info.voxels);
  info.geometry = imageGeometry(image);
  takeUnits(path, info);
  tidyGeometry(path, info.geometry, info.notes);
  const Component component = image.GetComponentType();
  if (const auto exact = exactVoxelType(component)) {
    info.voxel_type = *exact;
  } else {
    visitComponent(component, [](auto) {});  // refuses types that are no numbers
    info.voxel_type = VoxelType::kFloat32;
    info.notes.push_back(itk::ImageIOBase::GetComponentTypeAsString(component) +
                         " voxels were converted to float32");
  }
  return info;
}

// Frames of a file that does not state the place of each. ITK stacks them as they come.
void describePlainFrames(const std::string& path, const DicomHeader& header,
                         const itk::ImageIOBase& image, const OpenOptions& options,
                         std::vector<std::string>& notes) {
  if (header.value(dicom::kNumberOfFrames).empty())  // of a file that was not walked to its end
    throw unusable(path,
                   "its header is packed or in an encoding of one maker, so where its frames are "
                   "is unknown; convert it with its own software");
  if (const std::string offsets = header.value(dicom::kGridFrameOffsets); !offsets.empty())
    return checkFrameOffsets(path, offsets);
  const std::string along = header.value(dicom::kFrameIncrementPointer);
  if (along == std::to_string(dicom::kFrameTime) ||
      along == std::to_string(dicom::kFrameTimeVector))
    notes.push_back("frames are steps of time in the file; they were stacked as slices");
  if (options.spacing) return;
  notes.push_back("frames have no positions: their order and their distance, " +
                  shortText(std::abs(image.GetSpacing(2))) + " mm, are assumptions");
}

// A 3-D image that cannot be streamed, in one file or behind a header in several: held in memory
// from the first readRows() until the last row was delivered. (ITK could stream some of them, but
// it then does not notice that the data end early.)
class WholeImageSource final : public VolumeSource {
 public:
  // `stored` is used if voxels have several values.
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
    const std::byte* from = buffer_.get() + static_cast<std::size_t>(first) * row_voxels *
                                                image_->GetComponentSize() * stored_.components;
    const std::size_t voxels = static_cast<std::size_t>(count) * row_voxels;
    if (stored_.components == 1)
      convertComponents(image_->GetComponentType(), from, voxels, info_.voxel_type, out);
    else
      decodeVoxels(stored_, voxels, out, [&](std::byte* to, std::size_t bytes) {
        std::memcpy(to, from, bytes);
        from += bytes;
      });
    if (first + count == info_.voxels.y * info_.voxels.z) buffer_.reset();
  }

  std::vector<std::string> files() const override { return files_; }
  std::string identity() const override { return {}; }
  std::uint64_t bufferBytes() const override {
    std::uint64_t bytes = 0;
    const bool overflow = __builtin_mul_overflow(
        static_cast<std::uint64_t>(elementCount(info_.voxels)),
        std::uint64_t{image_->GetComponentSize()} * stored_.components, &bytes);
    return overflow ? std::numeric_limits<std::uint64_t>::max() : bytes;
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

// Volumes one behind the other: of which time step, of how many.
struct TimeStep {
  std::uint64_t index = 0, count = 1;
};

// The chosen one, or the first. A note says so.
TimeStep chooseTimeStep(const std::string& path, const itk::ImageIOBase& image,
                        const OpenOptions& options, std::vector<std::string>& notes) {
  TimeStep step;
  if (image.GetNumberOfDimensions() > 3) step.count = image.GetDimensions(3);
  if (options.time &&
      (*options.time < 0 || static_cast<std::uint64_t>(*options.time) >= step.count))
    throw unusable(path, "its time steps are 0 to " + std::to_string(step.count - 1) +
                             ", and none is number " + std::to_string(*options.time));
  step.index = static_cast<std::uint64_t>(options.time.value_or(0));
  if (step.count > 1)
    notes.push_back("time step " + std::to_string(step.index) + " of " +
                    std::to_string(step.count) + ", counted from 0, was taken");
  return step;
}

std::unique_ptr<VolumeSource> openNiftiRun(VolumeInfo info, std::uint64_t components,
                                           const TimeStep& time, const OpenOptions& options) {
  NiftiRun nifti = findNiftiRun(info.source);
  StoredVoxels& stored = nifti.stored;
  // ITK makes millimetres of the spacing, and not of the origin.
  const glm::dvec3 spacing = info.geometry.spacing;
  takeLengthUnits({nifti.length_unit, nifti.length_unit, nifti.length_unit}, info.geometry,
                  info.notes);
  info.geometry.spacing = spacing;
  const auto contradiction = [&] {
    return unreadable(info.source, "its header is contradictory; check that it is not damaged");
  };
  if (nifti.numbers_together > 1) stored.map.reset();  // it is of plain numbers
  if (stored.delivered() != info.voxel_type) throw contradiction();
  if (nifti.numbers_together != 1 && nifti.numbers_together != components) throw contradiction();
  if (stored.map)
    info.notes.push_back("slope " + shortText(stored.map->slope) + " and intercept " +
                         shortText(stored.map->intercept) + " were applied to the stored values");
  if (nifti.numbers_together > 1) takeComponent(components, options, stored, info);
  const auto bytes = stored.bytesOf(elementCount(info.voxels));
  // For the volumes in the file, one behind the other.
  const auto runOf = [&](std::uint64_t volume) {
    RawRun run = nifti.run;
    std::uint64_t& offset = run.is_deflated ? run.content_offset_bytes : run.offset_bytes;
    std::uint64_t skipped = 0;
    if (!bytes || __builtin_mul_overflow(*bytes, volume, &skipped) ||
        __builtin_add_overflow(offset, skipped, &offset))
      throw contradiction();
    return run;
  };
  // Another step is another volume when a pyramid is compared with its input.
  const auto nameStep = [&](VolumeInfo& of) {
    if (time.count > 1)
      of.encoding +=
          (of.encoding.empty() ? "" : ", ") + ("time step " + std::to_string(time.index));
  };
  if (components == nifti.numbers_together) {
    nameStep(info);
    return openRawRun(std::move(info), runOf(time.index), stored, options.cancel);
  }

  // The components are volumes, too, each of all time steps.
  VolumeInfo chosen = info;
  StoredVoxels unused = stored;
  takeComponent(components, options, unused, chosen);
  nameStep(chosen);
  const auto openComponent = [&](std::uint64_t component, const VolumeInfo& component_info) {
    std::uint64_t volume = 0;
    if (__builtin_mul_overflow(component, time.count, &volume) ||
        __builtin_add_overflow(volume, time.index, &volume))
      throw contradiction();
    return openRawRun(component_info, runOf(volume), stored, options.cancel);
  };
  // The last one shows whether the file is whole, if it is not packed.
  if (!nifti.run.is_deflated) openComponent(components - 1, info);
  if (!options.component->magnitude) {
    chosen.voxel_type = info.voxel_type;
    return openComponent(static_cast<std::uint64_t>(options.component->index), chosen);
  }
  std::vector<std::unique_ptr<VolumeSource>> sources;
  for (std::uint64_t c = 0; c < components; ++c) sources.push_back(openComponent(c, info));
  return makeMagnitudeSource(std::move(chosen), std::move(sources));
}

// The file, and those that it names. ITK tells MetaImage by its ending and NRRD by its first bytes.
std::vector<std::string> filesOf(const std::string& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return {path};
  const std::string ending = lowerExtension(path);
  return ending == ".mhd" || ending == ".mha" ? metaImageFiles(path) : nrrdFiles(path);
}

std::unique_ptr<VolumeSource> openImageFile(const std::string& path, std::vector<std::string> files,
                                            itk::ImageIOBase::Pointer image,
                                            const OpenOptions& options,
                                            std::vector<std::string> notes = {}) {
  VolumeInfo info = describeVolume(path, *image, std::move(notes));
  const auto components = static_cast<std::uint64_t>(image->GetNumberOfComponents());
  if (info.format == "TIFF") checkTiffPages(path);
  if (info.format == "NIfTI") {
    const TimeStep time = chooseTimeStep(path, *image, options, info.notes);
    return openNiftiRun(std::move(info), components, time, options);
  }
  const auto run = info.format == "NRRD"        ? findNrrdRun(path, components, info.voxels)
                   : info.format == "MetaImage" ? findMetaImageRun(path)
                                                : std::nullopt;
  const auto type = storedTypeOf(image->GetComponentType());
  if (components > 1 && !type)
    throw unusable(path, "its values are no numbers of up to 64 bits; convert it");
  StoredVoxels stored;
  stored.type = type.value_or(StoredType::kUint8);
  takeComponent(components, options, stored, info);
  if (run && type && image->GetNumberOfDimensions() == 3) {
    stored.big_endian = run->big_endian;
    return openRawRun(std::move(info), *run, stored, options.cancel);
  }
  auto source = std::make_unique<WholeImageSource>(std::move(info), std::move(files),
                                                   std::move(image), stored, options.cancel);
  if (source->info().format == "MRC") checkMrcBytes(path, source->bufferBytes());
  return source;
}

}  // namespace

std::unique_ptr<VolumeSource> openItkFile(const std::string& path, const OpenOptions& options) {
  static_cast<void>(InputFile(path));  // refuses a pipe, which ITK would wait for
  // First: ITK must not get a header with bad names.
  std::vector<std::string> files = filesOf(path);
  // ITK opens the files that a header names, to find their lengths.
  for (const std::string& file : files) {
    std::error_code ignored;
    const auto status = std::filesystem::status(file, ignored);
    if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
      static_cast<void>(InputFile(file, path));
  }
  if (const auto header = dicomImageHeader(path)) return openDicomFile(path, *header, options);
  if (auto pages = openTiffFile(path, options)) return pages;
  return openImageFile(path, std::move(files), openImage(path, options), options);
}

std::unique_ptr<VolumeSource> openDicomFile(const std::string& path, const DicomHeader& header,
                                            const OpenOptions& options) {
  if (hasDicomFrames(header)) return openDicomFrames(path, header, options);
  if (options.time || options.channel || !options.grid.empty())
    throw unusable(path,
                   "it does not say of its frames to which time, channel or stack they belong; "
                   "leave out the choice of one");
  itk::ImageIOBase::Pointer image = openDicomImage(path, header.stamp, options);
  std::vector<std::string> notes;
  noteMonochrome1(header.value(dicom::kPhotometricInterpretation), notes);
  if (imageVoxels(path, *image).z > 1) describePlainFrames(path, header, *image, options, notes);
  return openImageFile(path, {path}, std::move(image), options, std::move(notes));
}

}  // namespace itk_detail

std::unique_ptr<VolumeSource> openItkSource(const std::string& path, const OpenOptions& options) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(path, ignored)) return itk_detail::openItkFile(path, options);
  refuseComponentChoice(path, options);
  try {
    return itk_detail::openItkFolder(path, options);
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
