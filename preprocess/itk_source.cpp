// Single files that ITK reads, and what the folder source shares with them.
#include <dlfcn.h>
#include <itkBioRadImageIOFactory.h>
#include <itkGDCMImageIO.h>
#include <itkGiplImageIOFactory.h>
#include <itkImageIOFactory.h>
#include <itkLSMImageIOFactory.h>
#include <itkMRCImageIOFactory.h>
#include <itkMetaDataObject.h>
#include <itkMetaImageIOFactory.h>
#include <itkNiftiImageIOFactory.h>
#include <itkNrrdImageIOFactory.h>
#include <itkPNGImageIOFactory.h>
#include <itkTIFFImageIOFactory.h>
#include <itkVTKImageIOFactory.h>
#include <unistd.h>

#include <cstdarg>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <mutex>
#include <new>
#include <sstream>

#include "preprocess/dicom_header.h"
#include "preprocess/itk_common.h"
#include "preprocess/nifti_check.h"
#include "preprocess/raw_run.h"
#include "preprocess/source_checks.h"

namespace isobrick {
namespace itk_detail {
namespace {

// Without ITK's CMake "use file" nothing is registered; and a factory that was registered twice
// would only be asked twice.
template <typename... Factories>
void registerFactories() {
  (itk::ObjectFactoryBase::RegisterFactory(Factories::New()), ...);
}

// ITK's messages carry addresses, class names and line breaks.
std::string plainMessage(std::string text) {
  for (char& c : text)
    if (c == '\n' || c == '\r' || c == '\t') c = ' ';
  // NRRD's are a chain of callers; the last one knows the reason: "... [nrrd] function: reason"
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

// Catches what a library prints on std::cerr while it lives: MetaIO reports there what it does not
// report otherwise, and the user gets one line for an error. One at a time in the process; another
// thread's std::cerr meanwhile is caught too.
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
                                                            {"GDCMImageIO", "DICOM"},
                                                            {"VTKImageIO", "VTK legacy"}};
  const std::string name = image.GetNameOfClass();
  if (const auto known = kNames.find(name); known != kNames.end()) return known->second;
  return name.substr(0, name.find("ImageIO"));
}

// Throws Error for DICOM files that are damaged or hold no image.
bool isDicomImage(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) return false;
  switch (readDicomHeader(path).state) {
    case DicomHeader::State::kNotDicom:
      return false;
    case DicomHeader::State::kNoImage:
      throw Error("cannot use '" + path + "': it is a DICOM file without an image; name the " +
                  "folder of the series");
    case DicomHeader::State::kDamaged:
      throw Error("cannot read '" + path + "': the DICOM file is cut short or damaged; get the " +
                  "whole file again");
    case DicomHeader::State::kImage:
      break;
  }
  return true;
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
    // DICOM is not among them: openImage() looks at such files itself (dicom_header.h).
    registerFactories<itk::NrrdImageIOFactory, itk::MetaImageIOFactory, itk::NiftiImageIOFactory,
                      itk::LSMImageIOFactory, itk::TIFFImageIOFactory, itk::PNGImageIOFactory,
                      itk::VTKImageIOFactory, itk::MRCImageIOFactory, itk::GiplImageIOFactory,
                      itk::BioRadImageIOFactory>();
  });
}

Error itkError(const std::string& path, const std::exception& exception) {
  if (dynamic_cast<const std::bad_alloc*>(&exception) != nullptr)
    return Error("cannot read '" + path + "': not enough memory for its voxels; check the " +
                 "dimensions in its header, or convert it to an uncompressed .mhd, which is read " +
                 "piece by piece");
  const auto* itk_exception = dynamic_cast<const itk::ExceptionObject*>(&exception);
  return Error(
      "cannot read '" + path + "': " +
      plainMessage(itk_exception != nullptr ? itk_exception->GetDescription() : exception.what()) +
      "; check that the file is whole and not damaged");
}

itk::ImageIOBase::Pointer openImage(const std::string& path) {
  prepareItk();
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status))
    throw Error("cannot open '" + path + "': " +
                (error ? error.message() : "No such file or directory") + "; check the path");
  itk::ImageIOBase::Pointer image;
  try {
    const CerrCapture silence;
    if (isDicomImage(path))
      image = itk::GDCMImageIO::New().GetPointer();
    else
      image = itk::ImageIOFactory::CreateImageIO(path.c_str(), itk::IOFileModeEnum::ReadMode);
    if (image.IsNotNull()) {
      image->SetFileName(path);
      image->ReadImageInformation();
    }
  } catch (const Error&) {
    throw;
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
  if (image.IsNull())
    throw Error("cannot read '" + path + "': it is unreadable or in no known format (NRRD, " +
                "MetaImage, NIfTI, TIFF, DICOM, MRC, VTK legacy, ...); a file without a header " +
                "needs --raw-dims and --raw-type");
  if (image->GetNumberOfComponents() != 1)
    throw Error("cannot use '" + path + "': it has " +
                std::to_string(image->GetNumberOfComponents()) +
                " values per voxel (colour, vector or complex); extract one channel first");
  return image;
}

Index3 imageVoxels(const std::string& path, const itk::ImageIOBase& image) {
  Index3 voxels(1);
  for (unsigned axis = 0; axis < image.GetNumberOfDimensions(); ++axis) {
    const auto count = image.GetDimensions(axis);
    if (axis >= 3 && count != 1)
      throw Error("cannot use '" + path + "': it has " + std::to_string(count) +
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

// The name that RawLayout has for a component, or none.
const char* rawTypeName(Component component) {
  switch (component) {
    case Component::UCHAR:
      return "u8";
    case Component::CHAR:
      return "i8";
    case Component::USHORT:
      return "u16";
    case Component::SHORT:
      return "i16";
    case Component::UINT:
      return "u32";
    case Component::INT:
      return "i32";
    case Component::FLOAT:
      return "f32";
    case Component::DOUBLE:
      return "f64";
    default:
      return nullptr;
  }
}

// A 3-D image in one file. Uncompressed NRRD and MetaImage files are read piece by piece; all
// others are held in memory from the first readSlices() until the last slice was delivered. (ITK
// could stream others too, but where it does it does not notice that the data end early.)
class ItkFileSource final : public VolumeSource {
 public:
  explicit ItkFileSource(const std::string& path) : image_(openImage(path)) {
    info_.source = path;
    info_.format = formatName(*image_);
    info_.voxels = imageVoxels(path, *image_);
    if (info_.voxels.z == 1)
      throw Error("cannot use '" + path + "': it is a single 2-D image; name the folder that " +
                  "holds all slices");
    checkVoxelCounts(path, info_.voxels);
    info_.geometry = imageGeometry(*image_);
    tidyGeometry(path, info_.geometry, info_.notes);
    chooseVoxelType();
    openAsRaw();
  }

  const VolumeInfo& info() const override { return info_; }

  void readSlices(std::int64_t first, std::int64_t count, void* out) override {
    if (raw_) return raw_->readSlices(first, count, out);
    const auto slice_voxels = static_cast<std::size_t>(info_.voxels.x * info_.voxels.y);
    const std::size_t voxels = slice_voxels * static_cast<std::size_t>(count);
    try {
      if (!buffer_) load();
    } catch (const std::bad_alloc& exception) {
      throw itkError(info_.source, exception);
    }
    convertComponents(
        image_->GetComponentType(),
        buffer_.get() + static_cast<std::size_t>(first) * slice_voxels * image_->GetComponentSize(),
        voxels, info_.voxel_type, out);
    if (first + count == info_.voxels.z) buffer_.reset();
  }

 private:
  void chooseVoxelType() {
    const Component component = image_->GetComponentType();
    if (const auto exact = exactVoxelType(component)) {
      info_.voxel_type = *exact;
    } else {
      visitComponent(component, [](auto) {});  // refuses what is no number
      info_.voxel_type = VoxelType::kFloat32;
      info_.notes.push_back(itk::ImageIOBase::GetComponentTypeAsString(component) +
                            " voxels were converted to float32");
    }
    std::string slope, intercept;
    const itk::MetaDataDictionary& metadata = image_->GetMetaDataDictionary();
    if (info_.format == "NIfTI" && itk::ExposeMetaData(metadata, "scl_slope", slope) &&
        itk::ExposeMetaData(metadata, "scl_inter", intercept) &&
        (std::atof(slope.c_str()) != 1 || std::atof(intercept.c_str()) != 0) &&
        std::atof(slope.c_str()) != 0)
      info_.notes.push_back("slope " + slope + " and intercept " + intercept +
                            " were applied to the stored values");
  }

  // Lets a file whose voxels are plain bytes be read as such.
  void openAsRaw() {
    const auto run = info_.format == "NRRD"        ? findNrrdRun(info_.source)
                     : info_.format == "MetaImage" ? findMetaImageRun(info_.source)
                                                   : std::nullopt;
    const char* const type = rawTypeName(image_->GetComponentType());
    if (run && type != nullptr && image_->GetNumberOfDimensions() == 3)
      raw_ = openRawRun(info_.source, *run, info_.voxels, type);
  }

  // The whole image into buffer_.
  void load() {
    if (info_.format == "NIfTI") checkNifti();
    const std::size_t bytes =
        static_cast<std::size_t>(elementCount(info_.voxels)) * image_->GetComponentSize();
    // More than the machine has would only be refused by the kernel, or not even by it.
    const auto physical = static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) *
                          static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
    if (bytes > physical) throw std::bad_alloc();
    auto whole = std::make_unique_for_overwrite<std::byte[]>(bytes);
    readImageSlices(info_.source, *image_, 0, info_.voxels.z, whole.get());
    buffer_ = std::move(whole);
  }

  void checkNifti() const {
    const itk::MetaDataDictionary& metadata = image_->GetMetaDataDictionary();
    std::string offset, bits;
    itk::ExposeMetaData(metadata, "vox_offset", offset);
    itk::ExposeMetaData(metadata, "bitpix", bits);
    const double needed =
        std::atof(offset.c_str()) +
        static_cast<double>(elementCount(info_.voxels)) * std::atof(bits.c_str()) / 8;
    checkNiftiWhole(info_.source, static_cast<std::uint64_t>(needed));
  }

  itk::ImageIOBase::Pointer image_;
  VolumeInfo info_;
  std::unique_ptr<VolumeSource> raw_;    // reads the voxels, where it is set
  std::unique_ptr<std::byte[]> buffer_;  // otherwise: the whole image
};

}  // namespace

std::unique_ptr<VolumeSource> openItkFile(const std::string& path) {
  return std::make_unique<ItkFileSource>(path);
}

}  // namespace itk_detail

std::unique_ptr<VolumeSource> openItkSource(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::is_directory(path, ignored) ? itk_detail::openItkFolder(path)
                                                      : itk_detail::openItkFile(path);
}

}  // namespace isobrick
