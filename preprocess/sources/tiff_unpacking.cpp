#include "isobrick/preprocess/sources/tiff_unpacking.h"

#include <tiffio.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>

#include "isobrick/preprocess/path_error.h"

namespace isobrick {
namespace {

// Takes the library's last message; nothing goes to stderr.
int keepMessage(TIFF* /*file*/, void* message, const char* /*module*/, const char* format,
                std::va_list arguments) {
  char text[200];
  std::vsnprintf(text, sizeof(text), format, arguments);
  *static_cast<std::string*>(message) = text;
  return 1;
}
int keepNoMessage(TIFF* /*file*/, void* /*message*/, const char* /*module*/, const char* /*format*/,
                  std::va_list /*arguments*/) {
  return 1;
}

struct CloseTiff {
  void operator()(TIFF* file) const { TIFFClose(file); }
};
struct FreeOptions {
  void operator()(TIFFOpenOptions* options) const { TIFFOpenOptionsFree(options); }
};

float floatOfHalf(std::uint16_t half) {
  const std::uint32_t sign = (half & 0x8000u) << 16, exponent = half >> 10 & 31u,
                      fraction = half & 0x3ffu;
  if (exponent == 0) {
    const float value = std::ldexp(static_cast<float>(fraction), -24);
    return sign != 0 ? -value : value;
  }
  return std::bit_cast<float>(sign | (exponent == 31 ? 255u : exponent + 112u) << 23 |
                              fraction << 13);
}

class PageUnpacker {
 public:
  PageUnpacker(const std::string& path, const TiffSlices::Form& form)
      : path_(path),
        form_(form),
        number_bytes_(form.is_half ? 2 : storedBytes(form.type)),
        row_bytes_(static_cast<std::size_t>(form.width * form.samples) * number_bytes_) {
    const std::unique_ptr<TIFFOpenOptions, FreeOptions> options(TIFFOpenOptionsAlloc());
    if (!options) throw std::bad_alloc();
    TIFFOpenOptionsSetErrorHandlerExtR(options.get(), keepMessage, &message_);
    TIFFOpenOptionsSetWarningHandlerExtR(options.get(), keepNoMessage, nullptr);
    // The library's own buffers are those of a strip or a tile, and of its tags.
    TIFFOpenOptionsSetMaxSingleMemAlloc(
        options.get(), static_cast<tmsize_t>(2 * pageBytes() + (std::size_t{64} << 20)));
    // Without a map: a file that becomes shorter must not end the program.
    file_.reset(TIFFOpenExt(path.c_str(), "rm", options.get()));
    if (!file_) throw failed();
  }

  void unpack(std::uint64_t page_at, std::vector<std::byte>& buffer) {
    if (TIFFSetSubDirectory(file_.get(), page_at) != 1) throw failed();
    checkForm();
    buffer.resize(static_cast<std::size_t>(form_.width * form_.height * form_.samples) *
                  (form_.is_half ? sizeof(float) : number_bytes_));
    page_ = buffer.data();
    const std::uint16_t planes =
        form_.is_separate ? static_cast<std::uint16_t>(form_.samples) : std::uint16_t{1};
    for (std::uint16_t plane = 0; plane < planes; ++plane)
      if (TIFFIsTiled(file_.get()) != 0)
        unpackTiles(plane);
      else
        unpackStrips(plane);
    if (form_.is_half) widenHalves();
  }

 private:
  std::size_t pageBytes() const { return row_bytes_ * static_cast<std::size_t>(form_.height); }
  // Of a row of one plane, or of all numbers side by side.
  std::uint64_t numbersPerPixel() const { return form_.is_separate ? 1 : form_.samples; }

  Error failed() const {
    return unreadable(path_, (message_.empty() ? "libtiff reports a failure" : message_) +
                                 "; check that the file is whole and not damaged");
  }

  template <typename T>
  T tag(std::uint32_t number) const {
    T value{};
    TIFFGetFieldDefaulted(file_.get(), number, &value);
    return value;
  }

  // The library has to see what was found before.
  void checkForm() const {
    const auto kind = tag<std::uint16_t>(TIFFTAG_SAMPLEFORMAT);
    const char name = infoOf(form_.type).name[0];
    const bool is_same_kind = kind == (name == 'u'   ? SAMPLEFORMAT_UINT
                                       : name == 'i' ? SAMPLEFORMAT_INT
                                                     : SAMPLEFORMAT_IEEEFP);
    if (tag<std::uint32_t>(TIFFTAG_IMAGEWIDTH) != form_.width ||
        tag<std::uint32_t>(TIFFTAG_IMAGELENGTH) != form_.height ||
        tag<std::uint16_t>(TIFFTAG_SAMPLESPERPIXEL) != form_.samples ||
        tag<std::uint16_t>(TIFFTAG_BITSPERSAMPLE) != 8 * number_bytes_ || !is_same_kind ||
        (tag<std::uint16_t>(TIFFTAG_PLANARCONFIG) == PLANARCONFIG_SEPARATE) != form_.is_separate)
      throw unreadable(path_,
                       "its tags say two things of a page's size or values; correct them, or "
                       "get the whole file again");
  }

  void unpackStrips(std::uint16_t plane) {
    const std::uint64_t row_bytes = form_.width * numbersPerPixel() * number_bytes_;
    const std::uint64_t rows =
        std::min<std::uint64_t>(tag<std::uint32_t>(TIFFTAG_ROWSPERSTRIP), form_.height);
    if (rows == 0) throw failed();
    if (form_.is_separate) part_.resize(static_cast<std::size_t>(rows * row_bytes));
    for (std::uint64_t row = 0; row < form_.height; row += rows) {
      const std::uint64_t count = std::min(rows, form_.height - row);
      std::byte* const to = form_.is_separate ? part_.data() : page_ + row * row_bytes;
      const auto bytes = static_cast<tmsize_t>(count * row_bytes);
      const std::uint32_t strip =
          TIFFComputeStrip(file_.get(), static_cast<std::uint32_t>(row), plane);
      if (TIFFReadEncodedStrip(file_.get(), strip, to, bytes) != bytes) throw failed();
      if (form_.is_separate) place({0, row}, {form_.width, count}, form_.width, plane);
    }
  }

  void unpackTiles(std::uint16_t plane) {
    const std::uint64_t width = tag<std::uint32_t>(TIFFTAG_TILEWIDTH),
                        height = tag<std::uint32_t>(TIFFTAG_TILELENGTH);
    std::uint64_t bytes = 0;
    constexpr std::uint64_t kMostTileBytes = std::uint64_t{1} << 30;
    if (width == 0 || height == 0 || __builtin_mul_overflow(width, height, &bytes) ||
        __builtin_mul_overflow(bytes, numbersPerPixel() * number_bytes_, &bytes) ||
        bytes > kMostTileBytes || TIFFTileSize64(file_.get()) != bytes)
      throw unreadable(path_, "its tiles have no size that could be; get the whole file again");
    part_.resize(static_cast<std::size_t>(bytes));
    for (std::uint64_t y = 0; y < form_.height; y += height)
      for (std::uint64_t x = 0; x < form_.width; x += width) {
        const std::uint32_t tile = TIFFComputeTile(file_.get(), static_cast<std::uint32_t>(x),
                                                   static_cast<std::uint32_t>(y), 0, plane);
        if (TIFFReadEncodedTile(file_.get(), tile, part_.data(), static_cast<tmsize_t>(bytes)) !=
            static_cast<tmsize_t>(bytes))
          throw failed();
        place({x, y}, {std::min(width, form_.width - x), std::min(height, form_.height - y)}, width,
              plane);
      }
  }

  struct Pixels {
    std::uint64_t x, y;
  };
  // part_, whose rows have `width` pixels, at pixel `first` of the page.
  void place(const Pixels& first, const Pixels& count, std::uint64_t width, std::uint64_t plane) {
    const std::uint64_t numbers = numbersPerPixel();
    for (std::uint64_t y = 0; y < count.y; ++y) {
      const std::byte* from = part_.data() + y * width * numbers * number_bytes_;
      std::byte* to =
          page_ + (first.y + y) * row_bytes_ + (first.x * form_.samples + plane) * number_bytes_;
      if (!form_.is_separate) {
        std::memcpy(to, from, count.x * numbers * number_bytes_);
        continue;
      }
      for (std::uint64_t x = 0; x < count.x; ++x)
        std::memcpy(to + x * form_.samples * number_bytes_, from + x * number_bytes_,
                    number_bytes_);
    }
  }

  // From the last one on: a wide number overwrites none that is still needed.
  void widenHalves() {
    for (std::size_t i = pageBytes() / 2; i-- > 0;) {
      std::uint16_t half;
      std::memcpy(&half, page_ + 2 * i, sizeof(half));
      const float wide = floatOfHalf(half);
      std::memcpy(page_ + sizeof(wide) * i, &wide, sizeof(wide));
    }
  }

  const std::string& path_;
  const TiffSlices::Form form_;
  const std::size_t number_bytes_, row_bytes_;
  std::string message_;
  std::unique_ptr<TIFF, CloseTiff> file_;
  std::byte* page_ = nullptr;
  std::vector<std::byte> part_;  // a tile, or a strip of one plane
};

}  // namespace

void unpackTiffPage(const std::string& path, std::uint64_t page_at, const TiffSlices::Form& form,
                    std::vector<std::byte>& buffer) {
  PageUnpacker(path, form).unpack(page_at, buffer);
}

}  // namespace isobrick
