// The common part of single files and folders: ITK itself, its errors, and the headers of images.
#include "isobrick/preprocess/sources/itk_common.h"

#include <itkImageIOFactory.h>
#include <itkPNGImageIOFactory.h>

#include <algorithm>
#include <iostream>
#include <map>
#include <mutex>
#include <new>
#include <sstream>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/voxel_components.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick::itk_detail {
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

// Stands before the buffer of std::cerr while any thread catches its own output.
class CerrByThread final : public std::streambuf {
 public:
  static void begin(std::string* caught) {
    CerrByThread& self = instance();
    const std::lock_guard lock(self.mutex_);
    if (self.captures_++ == 0) self.others_ = std::cerr.rdbuf(&self);
    caught_ = caught;
  }
  static void end() {
    CerrByThread& self = instance();
    const std::lock_guard lock(self.mutex_);
    caught_ = nullptr;
    if (--self.captures_ == 0) std::cerr.rdbuf(self.others_);
  }

 protected:
  int_type overflow(int_type c) override {
    if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
    const char one = traits_type::to_char_type(c);
    return xsputn(&one, 1) == 1 ? c : traits_type::eof();
  }
  std::streamsize xsputn(const char* text, std::streamsize count) override {
    if (caught_ != nullptr) {
      caught_->append(text, static_cast<std::size_t>(count));
      return count;
    }
    const std::lock_guard lock(mutex_);
    return others_->sputn(text, count);
  }
  int sync() override {
    if (caught_ != nullptr) return 0;
    const std::lock_guard lock(mutex_);
    return others_->pubsync();
  }

 private:
  static CerrByThread& instance() {
    static CerrByThread* const the_one =
        new CerrByThread;  // another thread may be in it at the end
    return *the_one;
  }

  static thread_local std::string* caught_;  // of this thread; null: it goes to the others
  std::mutex mutex_;                         // guards both below
  int captures_ = 0;
  std::streambuf* others_ = nullptr;
};
thread_local std::string* CerrByThread::caught_ = nullptr;

// Catches what this thread prints on std::cerr while it lives: MetaIO reports some errors only
// there, and the user gets one line for an error. Other threads print as before.
class CerrCapture {
 public:
  CerrCapture() { CerrByThread::begin(&text_); }
  ~CerrCapture() { CerrByThread::end(); }
  CerrCapture(const CerrCapture&) = delete;
  CerrCapture& operator=(const CerrCapture&) = delete;
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

Error unknownFormat(const std::string& path) {
  static constexpr std::pair<const char*, const char*> kConverters[] = {
      {".gipl", "save it as .nrrd with 3D Slicer"},
      {".gipl.gz", "save it as .nrrd with 3D Slicer"},
      {".pic", "save it as .tif with Fiji"},
      {".zip", "unpack it and name the folder"}};
  for (const auto& [ending, advice] : kConverters)
    if (lowercase(path).ends_with(ending))
      return unusable(path, std::string("this format is not read; ") + advice);
  return unreadable(path,
                    "it is unreadable or in no known format (NRRD, MetaImage, NIfTI, TIFF, DICOM, "
                    "MRC, VTI, ...); say its layout if it has no header",
                    {Remedy::kDescribeRawFile});
}

// The image of a reader, which may be null: no known format. `options` decide about several values
// per voxel.
template <typename MakeReader>
itk::ImageIOBase::Pointer openBy(const std::string& path, const OpenOptions& options,
                                 MakeReader&& makeReader) {
  itk::ImageIOBase::Pointer image;
  try {
    const CerrCapture silence;
    image = makeReader();
    if (image.IsNotNull()) {
      image->SetFileName(path);
      image->ReadImageInformation();
    }
  } catch (const Error&) {
    throw;
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
  if (image.IsNull()) throw unknownFormat(path);
  const Component component = image->GetComponentType();
  if (component == Component::UNKNOWNCOMPONENTTYPE || component == Component::LDOUBLE)
    throw unusable(path, "this kind of voxel is not supported; convert it to a scalar type first");
  checkComponentChoice(path, image->GetNumberOfComponents(), options);
  return image;
}

}  // namespace

void prepareItk() {
  static std::once_flag once;
  std::call_once(once, [] {
    itk::Object::GlobalWarningDisplayOff();
    // DICOM is not among them: such files are read by dicom_header.h.
    registerFactories<itk::PNGImageIOFactory>();
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

std::string formatName(const itk::ImageIOBase& image) {
  const std::string name = image.GetNameOfClass();
  return name.substr(0, name.find("ImageIO"));
}

std::optional<DicomHeader> dicomImageHeader(const std::string& path) {
  if (!isRegularFile(path)) return std::nullopt;
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

itk::ImageIOBase::Pointer openImage(const std::string& path, const OpenOptions& options) {
  prepareItk();
  static_cast<void>(InputFile(path));  // says why it cannot be opened
  return openBy(path, options, [&] {
    return itk::ImageIOFactory::CreateImageIO(path.c_str(), itk::IOFileModeEnum::ReadMode);
  });
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

StoredType storedTypeOf(Component component) {
  return visitComponent(component, [](auto tag) {
    using T = typename decltype(tag)::Type;
    return *isobrick::storedTypeOf(std::is_floating_point_v<T> ? 'f'
                                   : std::is_signed_v<T>       ? 'i'
                                                               : 'u',
                                   sizeof(T));
  });
}

std::optional<VoxelType> exactVoxelType(Component component) {
  return voxelTypeNamed(infoOf(storedTypeOf(component)).name);
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
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
}

}  // namespace isobrick::itk_detail
