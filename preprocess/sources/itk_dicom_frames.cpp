// Enhanced DICOM files: frames in the order of their positions, each with a slope and an intercept
// of its own. GDCM, by which ITK reads DICOM, has one of each for a file.
#include <gdcmImageReader.h>
#include <gdcmTrace.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_stack.h"
#include "isobrick/preprocess/sources/dicom_tags.h"
#include "isobrick/preprocess/sources/itk_common.h"
#include "isobrick/preprocess/sources/stored_file.h"
#include "isobrick/storage/abandonable.h"

namespace isobrick::itk_detail {
namespace {

// Pixels as a file has them: little-endian, of 1, 2 or 4 bytes.
struct StoredPixel {
  unsigned bytes = 2, bits = 16, shift = 0;
  bool is_signed = false;

  double valueOf(const std::byte* from) const {
    std::uint32_t stored = 0;
    for (unsigned i = 0; i < bytes; ++i)
      stored |= std::to_integer<std::uint32_t>(from[i]) << (8 * i);
    stored >>= shift;
    if (bits < 32) stored &= (std::uint32_t{1} << bits) - 1;
    if (is_signed && (stored >> (bits - 1) & 1) != 0)
      return static_cast<double>(std::int64_t{stored} - (std::int64_t{1} << bits));
    return stored;
  }
};

// The upper bits may hold something else: those below the high bit count.
StoredPixel storedPixel(const DicomHeader& header, const DicomValueMap& map) {
  StoredPixel pixel;
  pixel.bytes = static_cast<unsigned>(map.bits_allocated) / 8;
  pixel.bits = static_cast<unsigned>(map.bits_stored);
  pixel.is_signed = map.is_signed;
  const std::string high_bit = header.value(dicom::kHighBit);
  const auto high = static_cast<unsigned>(std::strtoul(high_bit.c_str(), nullptr, 10));
  if (!high_bit.empty() && high < 8 * pixel.bytes && high + 1 > pixel.bits)
    pixel.shift = high + 1 - pixel.bits;
  return pixel;
}

using PixelBytes = std::shared_ptr<std::vector<char>>;

// All frames of a packed file.
PixelBytes unpackFrames(const std::string& path, const FileStamp& stamp, std::uint64_t bytes) {
  const auto fail = [&](const std::string& why) {
    return unreadable(path, why + "; get the whole file again, or unpack it");
  };
  if (fileStamp(path) != stamp) throw fail("it changed since its header was read");
  for (const auto silence : {gdcm::Trace::WarningOff, gdcm::Trace::ErrorOff, gdcm::Trace::DebugOff})
    silence();
  try {
    gdcm::ImageReader reader;
    reader.SetFileName(path.c_str());
    if (!reader.Read()) throw fail("its pixels are damaged or packed in a way that GDCM lacks");
    const gdcm::Image& image = reader.GetImage();
    if (image.GetBufferLength() != bytes) throw fail("its pixels are not as its header says");
    auto pixels = std::make_shared<std::vector<char>>(bytes);
    if (!image.GetBuffer(pixels->data()))
      throw fail("its pixels are damaged or packed in a way that GDCM lacks");
    return pixels;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& exception) {
    throw itkError(path, exception);
  }
}

// Frames that lie in the file as they are are read in place; others are unpacked at once, with the
// first row, and held until the last row was delivered.
class DicomFramesSource final : public VolumeSource {
 public:
  DicomFramesSource(DicomFrames volume, const DicomHeader& header, const CancelFlag* cancel)
      : volume_(std::move(volume)),
        pixel_(storedPixel(header, volume_.maps.front())),
        stamp_(header.stamp),
        pixels_at_(header.pixels_at),
        is_packed_(!liesAsItIs(header)),
        cancel_(cancel) {
    // At least one bit a pixel and some bytes a frame are in the file, so this fits 64 bits.
    frame_bytes_ = static_cast<std::uint64_t>(info().voxels.x * info().voxels.y) * pixel_.bytes;
    if (!is_packed_) file_.emplace(info().source);
  }

  const VolumeInfo& info() const override { return volume_.info; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const Index3& voxels = info().voxels;
    auto* to = static_cast<std::byte*>(out);
    for (std::int64_t row = first; row < first + count;) {
      const std::int64_t k = row / voxels.y, y = row % voxels.y;
      const std::int64_t rows = std::min(voxels.y - y, first + count - row);
      const auto pixels = static_cast<std::size_t>(rows * voxels.x);
      convert(k, readPixels(k, y, pixels), pixels, to);
      to += pixels * voxelBytes(info().voxel_type);
      row += rows;
    }
    if (first + count == voxels.y * voxels.z) unpacked_.reset();
  }

  std::vector<std::string> files() const override { return {info().source}; }
  // GDCM has the packed pixels too.
  std::uint64_t bufferBytes() const override {
    return is_packed_ ? allBytes() + stamp_.bytes : frame_bytes_;
  }

 private:
  static bool liesAsItIs(const DicomHeader& header) {
    const std::string syntax = header.value(dicom::kTransferSyntax);
    return header.pixel_bytes > 0 &&
           (syntax == "1.2.840.10008.1.2" || syntax == "1.2.840.10008.1.2.1");
  }

  std::uint64_t allBytes() const { return frame_bytes_ * volume_.frames_in_file; }

  const std::byte* readPixels(std::int64_t slice, std::int64_t y, std::size_t pixels) {
    const std::uint64_t at = frame_bytes_ * volume_.frames[static_cast<std::size_t>(slice)] +
                             static_cast<std::uint64_t>(y * info().voxels.x) * pixel_.bytes;
    if (is_packed_) {
      if (!unpacked_)
        unpacked_ =
            runAbandonable(cancel_, [path = info().source, stamp = stamp_, bytes = allBytes()] {
              return unpackFrames(path, stamp, bytes);
            });
      return reinterpret_cast<const std::byte*>(unpacked_->data()) + at;
    }
    if (cancel_ != nullptr) cancel_->check();
    rows_.resize(pixels * pixel_.bytes);
    if (file_->readAt(pixels_at_ + at, rows_.data(), rows_.size()) < rows_.size())
      throw becameShorter(*file_, slice, pixels_at_ + at);
    return rows_.data();
  }

  void convert(std::int64_t slice, const std::byte* from, std::size_t pixels, void* out) const {
    const DicomValueMap& map = volume_.maps[static_cast<std::size_t>(slice)];
    visitVoxelType(info().voxel_type, [&](auto tag) {
      using Out = typename decltype(tag)::Type;
      Out* const to = static_cast<Out*>(out);
      for (std::size_t i = 0; i < pixels; ++i) {
        const double value = map.slope * pixel_.valueOf(from + i * pixel_.bytes) + map.intercept;
        // Whatever the header said: nothing is cut off.
        if constexpr (std::is_integral_v<Out>)
          if (value < std::numeric_limits<Out>::min() || value > std::numeric_limits<Out>::max())
            throw misfit(slice, value);
        to[i] = static_cast<Out>(value);
      }
    });
  }

  Error misfit(std::int64_t slice, double value) const {
    return Error("cannot read frame " +
                     std::to_string(volume_.frames[static_cast<std::size_t>(slice)] + 1) + " of '" +
                     info().source + "': its value " + std::to_string(std::llround(value)) +
                     " does not fit the " + std::string(voxelTypeName(info().voxel_type)) +
                     " that the headers suggest; take it as float32",
                 {.path = info().source}, {Remedy::kDicomAsFloat32});
  }

  DicomFrames volume_;
  StoredPixel pixel_;
  FileStamp stamp_;
  std::uint64_t pixels_at_ = 0, frame_bytes_ = 0;
  bool is_packed_ = false;
  const CancelFlag* cancel_;
  std::optional<InputFile> file_;
  std::vector<std::byte> rows_;
  PixelBytes unpacked_;
};

}  // namespace

std::unique_ptr<VolumeSource> openDicomFrames(const std::string& path, const DicomHeader& header,
                                              const OpenOptions& options) {
  return std::make_unique<DicomFramesSource>(arrangeDicomFrames(path, header, options), header,
                                             options.cancel);
}

}  // namespace isobrick::itk_detail
