// The pixels of DICOM slices, unpacked by GDCM if they are packed. It gets nothing of a file but
// these: its own reading of headers aborts on elements of types that it does not expect.
#include <gdcmImageReader.h>
#include <gdcmTrace.h>

#include <algorithm>
#include <limits>
#include <new>
#include <sstream>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_source.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/abandonable.h"

namespace isobrick {
namespace {

// Pixels of 1, 2 or 4 bytes. The bits above the high bit may hold something else.
struct StoredPixels {
  StoredPixels(const DicomFile& file, const DicomValueMap& values)
      : bytes(static_cast<unsigned>(values.bits_allocated) / 8),
        bits(static_cast<unsigned>(values.bits_stored)),
        shift(static_cast<unsigned>(values.high_bit + 1 - values.bits_stored)),
        is_signed(values.is_signed),
        big_endian(file.packed_bytes == 0 &&
                   (file.syntax == dicom::kBigEndian || file.syntax == dicom::kImplicitOfGe)) {}

  // Calls `take` with each of `count` numbers. Stored: unsigned, of `bytes`.
  template <typename Stored, typename Take>
  void forEachOf(const std::byte* from, std::size_t count, Take take) const {
    const std::int64_t range = std::int64_t{1} << bits, half = range / 2;
    for (std::size_t i = 0; i < count; ++i, from += sizeof(Stored)) {
      const auto stored = static_cast<std::int64_t>(loadNumber<Stored>(from, big_endian) >> shift);
      const std::int64_t value = stored & (range - 1);
      take(i, is_signed && value >= half ? value - range : value);
    }
  }
  template <typename Take>
  void forEach(const std::byte* from, std::size_t count, Take take) const {
    if (bytes == 1) return forEachOf<std::uint8_t>(from, count, take);
    if (bytes == 2) return forEachOf<std::uint16_t>(from, count, take);
    forEachOf<std::uint32_t>(from, count, take);
  }

  unsigned bytes, bits, shift;
  bool is_signed, big_endian;
};

// A file of GDCM's liking, up to its pixels.
class HeaderForGdcm {
 public:
  explicit HeaderForGdcm(const DicomFile& file) : bytes_(128, '\0') {
    bytes_ += "DICM";
    const char* const kind = file.frames > 1 ? "1.2.840.10008.5.1.4.1.1.7.3"  // secondary captures
                                             : "1.2.840.10008.5.1.4.1.1.7";
    add(0x00020002, "UI", kind);
    add(dicom::kTransferSyntax, "UI", file.syntax);
    add(dicom::kImageKind, "UI", kind);
    addNumber(dicom::kSamplesPerPixel, 1);
    add(dicom::kPhotometricInterpretation, "CS", "MONOCHROME2");
    if (file.frames > 1) add(dicom::kNumberOfFrames, "IS", std::to_string(file.frames));
    addNumber(dicom::kRows, file.rows);
    addNumber(dicom::kColumns, file.columns);
    addNumber(dicom::kBitsAllocated, file.values.bits_allocated);
    addNumber(dicom::kBitsStored, file.values.bits_stored);
    addNumber(dicom::kHighBit, file.values.high_bit);
    addNumber(dicom::kPixelRepresentation, file.values.is_signed ? 1 : 0);
    addTag(dicom::kPixelData);
    bytes_ += std::string("OB\0\0\xff\xff\xff\xff", 8);
  }

  const std::string& bytes() const { return bytes_; }

 private:
  void add16(std::uint32_t value) {
    bytes_ += static_cast<char>(value & 255);
    bytes_ += static_cast<char>(value >> 8 & 255);
  }
  void addTag(std::uint32_t tag) {
    add16(tag >> 16);
    add16(tag & 0xffff);
  }
  void add(std::uint32_t tag, const char* type, std::string value) {
    if (value.size() % 2 != 0) value += type[0] == 'U' ? '\0' : ' ';
    addTag(tag);
    bytes_ += type;
    add16(static_cast<std::uint32_t>(value.size()));
    bytes_ += value;
  }
  void addNumber(std::uint32_t tag, std::int64_t value) {
    addTag(tag);
    bytes_ += "US";
    add16(2);
    add16(static_cast<std::uint32_t>(value));
  }

  std::string bytes_;
};

using PixelBytes = std::shared_ptr<std::vector<char>>;

InputFile openUnchanged(const DicomFile& file) {
  if (fileStamp(file.path) != file.stamp)
    throw unreadable(file.path,
                     "it changed since its header was read; run again when nobody writes to it");
  return InputFile(file.path);
}

// All frames of a packed file, `bytes` in all.
PixelBytes unpackFrames(const DicomFile& file, std::uint64_t bytes) {
  const auto fail = [&](const std::string& why) {
    return unreadable(file.path, why, "; get the whole file again, or unpack it");
  };
  for (const auto silence : {gdcm::Trace::WarningOff, gdcm::Trace::ErrorOff, gdcm::Trace::DebugOff})
    silence();
  std::string packed = HeaderForGdcm(file).bytes();
  const std::size_t header_bytes = packed.size();
  packed.resize(header_bytes + file.packed_bytes);
  if (openUnchanged(file).readAt(file.pixels_at, packed.data() + header_bytes, file.packed_bytes) <
      file.packed_bytes)
    throw fail("it became shorter meanwhile");
  try {
    std::istringstream stream(std::move(packed));
    gdcm::ImageReader reader;
    reader.SetStream(stream);
    if (!reader.Read()) throw fail("its pixels are damaged or packed in a way that GDCM lacks");
    const gdcm::Image& image = reader.GetImage();
    if (image.GetBufferLength() != bytes) throw fail("its pixels are not as its header says");
    auto pixels = std::make_shared<std::vector<char>>(bytes);
    if (!image.GetBuffer(pixels->data()))
      throw fail("its pixels are damaged or packed in a way that GDCM lacks");
    return pixels;
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw fail("not enough memory for its pixels");
  } catch (const std::exception& exception) {
    throw fail(exception.what());
  }
}

class DicomSource final : public VolumeSource {
 public:
  DicomSource(VolumeInfo info, std::vector<DicomFile> files, std::vector<DicomSlice> slices,
              const CancelFlag* cancel)
      : info_(std::move(info)),
        files_(std::move(files)),
        slices_(std::move(slices)),
        cancel_(cancel) {}

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const Index3& voxels = info_.voxels;
    forEachSliceOfRows(info_, first, count, out,
                       [&](std::int64_t k, std::int64_t y, std::int64_t rows, std::byte* to) {
                         const auto pixels = static_cast<std::size_t>(rows * voxels.x);
                         convert(k, readPixels(k, y, pixels), pixels, to);
                       });
    if (first + count == voxels.y * voxels.z) unpacked_.reset();
  }

  std::vector<std::string> files() const override {
    std::vector<std::string> paths;
    for (const DicomFile& file : files_) paths.push_back(file.path);
    return paths;
  }
  // GDCM has the packed pixels twice.
  std::uint64_t bufferBytes() const override {
    std::uint64_t most = 0;
    for (const DicomFile& file : files_)
      most = std::max(
          most, file.packed_bytes > 0 ? bytesOf(file) + 2 * file.packed_bytes : frameBytes(file));
    return most;
  }

 private:
  // At least one bit a pixel and some bytes a frame are in the file, so these fit 64 bits.
  std::uint64_t frameBytes(const DicomFile& file) const {
    return static_cast<std::uint64_t>(info_.voxels.x * info_.voxels.y) *
           static_cast<std::uint64_t>(file.values.bits_allocated / 8);
  }
  std::uint64_t bytesOf(const DicomFile& file) const {
    return frameBytes(file) * static_cast<std::uint64_t>(file.frames);
  }
  const DicomSlice& slice(std::int64_t k) const { return slices_[static_cast<std::size_t>(k)]; }
  const DicomFile& fileOf(std::int64_t k) const { return files_[slice(k).file]; }

  const std::byte* readPixels(std::int64_t k, std::int64_t y, std::size_t pixels) {
    const DicomFile& file = fileOf(k);
    const auto pixel_bytes = static_cast<std::uint64_t>(file.values.bits_allocated / 8);
    const std::uint64_t at = frameBytes(file) * slice(k).frame +
                             static_cast<std::uint64_t>(y * info_.voxels.x) * pixel_bytes;
    const bool is_other_file = open_file_ != slice(k).file;
    if (is_other_file) {
      unpacked_.reset();
      in_place_.reset();
    }
    open_file_ = slice(k).file;
    if (cancel_ != nullptr) cancel_->check();
    if (file.packed_bytes > 0) {
      // A large packed file takes seconds, and its library does not stop before its end.
      if (!unpacked_)
        unpacked_ = runAbandonable(
            cancel_, [file, bytes = bytesOf(file)] { return unpackFrames(file, bytes); });
      return reinterpret_cast<const std::byte*>(unpacked_->data()) + at;
    }
    if (!in_place_) in_place_.emplace(openUnchanged(file));
    rows_.resize(pixels * pixel_bytes);
    if (in_place_->readAt(file.pixels_at + at, rows_.data(), rows_.size()) < rows_.size())
      throw becameShorter(*in_place_, k, file.pixels_at + at);
    return rows_.data();
  }

  void convert(std::int64_t k, const std::byte* from, std::size_t pixels, void* out) const {
    const DicomValueMap& map = slice(k).values;
    const StoredPixels stored(fileOf(k), map);
    visitVoxelType(info_.voxel_type, [&](auto tag) {
      using Out = typename decltype(tag)::Type;
      Out* const to = static_cast<Out*>(out);
      stored.forEach(from, pixels, [&](std::size_t i, std::int64_t number) {
        const double value = map.slope * static_cast<double>(number) + map.intercept;
        // Whatever the header said: nothing is cut off.
        if constexpr (std::is_integral_v<Out>)
          if (value < std::numeric_limits<Out>::min() || value > std::numeric_limits<Out>::max())
            throw misfit(k, value);
        to[i] = static_cast<Out>(value);
      });
    });
  }

  Error misfit(std::int64_t k, double value) const {
    const std::string& path = fileOf(k).path;
    const std::string where =
        files_.size() > 1 ? "slice " + std::to_string(k) + ", '" + path + "'"
                          : "frame " + std::to_string(slice(k).frame + 1) + " of '" + path + "'";
    return fileError(path, "cannot read ", where, ": its value ", std::llround(value),
                     " does not fit the ", voxelTypeName(info_.voxel_type),
                     " that the headers suggest; take it as float32", Remedy::kDicomAsFloat32);
  }

  VolumeInfo info_;
  std::vector<DicomFile> files_;
  std::vector<DicomSlice> slices_;
  const CancelFlag* cancel_;
  // Of the file of the slice that was read last:
  std::size_t open_file_ = std::numeric_limits<std::size_t>::max();
  std::optional<InputFile> in_place_;
  std::vector<std::byte> rows_;
  PixelBytes unpacked_;
};

}  // namespace

std::unique_ptr<VolumeSource> makeDicomSource(VolumeInfo info, std::vector<DicomFile> files,
                                              std::vector<DicomSlice> slices,
                                              const CancelFlag* cancel) {
  return std::make_unique<DicomSource>(std::move(info), std::move(files), std::move(slices),
                                       cancel);
}

}  // namespace isobrick
