#include "isobrick/preprocess/sources/tiff_file.h"

#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <string_view>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/source_checks.h"

namespace isobrick {
namespace {

// Keeps the library's message, which it would print; of warnings nothing.
int keepMessage(TIFF* /*file*/, void* message, const char* /*module*/, const char* format,
                std::va_list arguments) {
  char text[200];
  std::vsnprintf(text, sizeof(text), format, arguments);
  if (message != nullptr) *static_cast<std::string*>(message) = text;
  return 1;
}

struct FreeOptions {
  void operator()(TIFFOpenOptions* options) const { TIFFOpenOptionsFree(options); }
};

// libtiff gives quotients in single precision: the simplest one that it may have read.
double quotientOf(float rounded) {
  double above = 1, below = 0, above_before = 0, below_before = 1, rest = rounded;
  for (int i = 0; i < 20; ++i) {
    const double whole = std::floor(rest);
    above_before = std::exchange(above, whole * above + above_before);
    below_before = std::exchange(below, whole * below + below_before);
    if (static_cast<float>(above / below) == rounded) return above / below;
    rest = 1 / (rest - whole);
  }
  return static_cast<double>(rounded);
}

// "JPEG 2000"; the library has no name for what it does not unpack at all.
std::string packingName(std::uint16_t packing) {
  if (packing == 34712 || packing == 33003 || packing == 33004 || packing == 33005)
    return "JPEG 2000";
  if (packing == 50002 || packing == 52546) return "JPEG XL";
  const TIFFCodec* const codec = TIFFFindCODEC(packing);
  return codec != nullptr ? codec->name : "number " + std::to_string(packing);
}

// Numbers of fewer than 16 bits, the highest bit first, as whole ones.
template <typename T>
void widenTo(const std::byte* from, std::size_t count, unsigned bits, std::byte* to) {
  std::uint32_t window = 0;
  unsigned held = 0;
  for (std::size_t i = 0; i < count; ++i) {
    for (; held < bits; held += 8) window = window << 8 | static_cast<std::uint32_t>(*from++);
    held -= bits;
    const auto value = static_cast<T>(window >> held & ((1u << bits) - 1));
    std::memcpy(to + i * sizeof(T), &value, sizeof(T));
  }
}

}  // namespace

std::optional<StoredType> TiffForm::type() const {
  if (kind == 'u' && bits < 16 && bits > 0) return storedTypeOf('u', bits <= 8 ? 1 : 2);
  return bits % 8 == 0 ? storedTypeOf(kind, bits / 8) : std::nullopt;
}

void TiffFile::Close::operator()(tiff* file) const { TIFFClose(file); }

bool TiffFile::isAt(const std::string& path) {
  using namespace std::string_view_literals;
  char begin[4] = {};
  const std::string_view magic(begin, InputFile(path).readAt(0, begin, sizeof(begin)));
  return magic == "II*\0"sv || magic == "MM\0*"sv || magic == "II+\0"sv || magic == "MM\0+"sv;
}

TiffFile::TiffFile(const std::string& path) : file_(path) {
  const std::unique_ptr<TIFFOpenOptions, FreeOptions> options(TIFFOpenOptionsAlloc());
  if (!options) throw std::bad_alloc();
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), keepMessage, &message_);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), keepMessage, nullptr);
  // Of tags, and of a packed strip or tile.
  constexpr std::uint64_t kMostTagBytes = std::uint64_t{1} << 28;
  TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(),
                                      static_cast<tmsize_t>(std::max(kMostTagBytes, file_.size())));
  // Without a map, as a file that becomes shorter must not end the program; places of strips when
  // they are asked for; strips as they are.
  tiff_.reset(TIFFOpenExt(path.c_str(), "rmOc", options.get()));
  if (!tiff_) throw failed();
}

Error TiffFile::failed() const {
  const std::string& path = file_.path();
  for (const char* const words : {"not supported", "not implemented", "Sorry", "annot handle"})
    if (message_.find(words) != std::string::npos)
      return unusable(path, "libtiff says ", quotedText(message_, 150),
                      "; save it with LZW, ZIP or no compression");
  return unreadable(path,
                    message_.empty() ? std::string("libtiff reports a failure")
                                     : "libtiff says " + quotedText(message_, 150),
                    "; check that the file is whole and not damaged");
}

template <typename T>
T TiffFile::tag(std::uint32_t number) const {
  T value{};
  TIFFGetFieldDefaulted(tiff_.get(), number, &value);
  return value;
}

void TiffFile::goTo(std::uint64_t page_at) {
  if (TIFFCurrentDirOffset(tiff_.get()) == page_at) return;
  if (TIFFSetSubDirectory(tiff_.get(), page_at) != 1) throw failed();
}

std::vector<TiffPage> TiffFile::pages(const OpenOptions& options, std::size_t most) {
  std::vector<TiffPage> pages{page()};
  while (pages.size() < most && TIFFLastDirectory(tiff_.get()) == 0) {
    options.checkCancel();
    if (TIFFReadDirectory(tiff_.get()) != 1) throw failed();
    pages.push_back(page());
    if (!pages.back().description.starts_with("{\"shape\"")) pages.back().description.clear();
  }
  if (pages.size() < most) checkLastPage(pages.back().at);
  return pages;
}

// To libtiff, a file that ends before the place of the next page has no next one.
void TiffFile::checkLastPage(std::uint64_t at) const {
  const bool is_big = TIFFIsBigTIFF(tiff_.get()) != 0;
  const std::size_t count_bytes = is_big ? 8 : 2, entry_bytes = is_big ? 20 : 12;
  std::array<std::byte, 8> count{};
  file_.readAt(at, count.data(), count_bytes);
  const std::uint64_t entries =
      loadUnsigned(count.data(), count_bytes, TIFFIsBigEndian(tiff_.get()) != 0);
  if (at + count_bytes + entries * entry_bytes + (is_big ? 8 : 4) > file_.size())
    throw unreadable(file_.path(), "it ends within its list of pages; get the whole file again");
}

TiffPage TiffFile::page() const {
  TiffPage page;
  page.form = form();
  page.at = TIFFCurrentDirOffset(tiff_.get());
  page.big_endian = TIFFIsBigEndian(tiff_.get()) != 0;
  page.is_smaller =
      (tag<std::uint32_t>(TIFFTAG_SUBFILETYPE) & (FILETYPE_REDUCEDIMAGE | FILETYPE_MASK)) != 0;
  page.unread = whyUnread(page.form);
  page.pixels_at = plainPixels(page.form);
  const char* description = nullptr;
  if (TIFFGetField(tiff_.get(), TIFFTAG_IMAGEDESCRIPTION, &description) == 1 &&
      description != nullptr)
    page.description = description;
  return page;
}

TiffForm TiffFile::form() const {
  TiffForm form;
  form.width = tag<std::uint32_t>(TIFFTAG_IMAGEWIDTH);
  form.height = tag<std::uint32_t>(TIFFTAG_IMAGELENGTH);
  form.samples = tag<std::uint16_t>(TIFFTAG_SAMPLESPERPIXEL);
  form.bits = tag<std::uint16_t>(TIFFTAG_BITSPERSAMPLE);
  const auto kind = tag<std::uint16_t>(TIFFTAG_SAMPLEFORMAT);
  form.kind = kind == SAMPLEFORMAT_UINT || kind == SAMPLEFORMAT_VOID ? 'u'
              : kind == SAMPLEFORMAT_INT                             ? 'i'
              : kind == SAMPLEFORMAT_IEEEFP                          ? 'f'
                                                                     : '?';
  form.is_separate =
      form.samples > 1 && tag<std::uint16_t>(TIFFTAG_PLANARCONFIG) == PLANARCONFIG_SEPARATE;
  const auto colours = tag<std::uint16_t>(TIFFTAG_PHOTOMETRIC);
  form.is_colour = colours == PHOTOMETRIC_RGB || colours == PHOTOMETRIC_YCBCR;
  return form;
}

std::string TiffFile::whyUnread(const TiffForm& form) const {
  const std::string otherwise = "; save it as grey ones of 8, 16 or 32 bits";
  if (form.kind == '?') return "its complex numbers are not read" + otherwise;
  if (!form.type()) return concat("its numbers of ", form.bits, " bits are not read", otherwise);
  const auto packing = tag<std::uint16_t>(TIFFTAG_COMPRESSION);
  if (TIFFIsCODECConfigured(packing) == 0)
    return "its packing (" + packingName(packing) +
           ") is none that libtiff unpacks here; save it with LZW, ZIP or no compression";
  const auto colours = tag<std::uint16_t>(TIFFTAG_PHOTOMETRIC);
  if ((colours == PHOTOMETRIC_YCBCR && packing != COMPRESSION_JPEG) ||
      colours == PHOTOMETRIC_LOGL || colours == PHOTOMETRIC_LOGLUV)
    return "its colours (YCbCr or LogLuv) are not read" + otherwise;
  if (tag<std::uint32_t>(TIFFTAG_IMAGEDEPTH) > 1)
    return "its tiles of several slices are not read; save it as pages of one slice each";
  if (tag<std::uint16_t>(TIFFTAG_ORIENTATION) > ORIENTATION_BOTLEFT)
    return "its rows are columns by its tag of orientation; save it with the first row on top";
  return {};
}

std::optional<std::uint64_t> TiffFile::plainPixels(const TiffForm& form) const {
  const auto type = form.type();
  if (!type || form.bits != 8 * storedBytes(*type) || form.is_separate || form.width == 0 ||
      form.height == 0 || TIFFIsTiled(tiff_.get()) != 0 ||
      tag<std::uint16_t>(TIFFTAG_COMPRESSION) != COMPRESSION_NONE ||
      tag<std::uint16_t>(TIFFTAG_FILLORDER) != FILLORDER_MSB2LSB ||
      tag<std::uint16_t>(TIFFTAG_ORIENTATION) != ORIENTATION_TOPLEFT)
    return std::nullopt;
  const std::uint64_t row_bytes = std::uint64_t{form.width} * form.samples * storedBytes(*type);
  const std::uint64_t rows = std::min(tag<std::uint32_t>(TIFFTAG_ROWSPERSTRIP), form.height);
  if (rows == 0) return std::nullopt;
  const std::uint64_t first = TIFFGetStrileOffset(tiff_.get(), 0);
  if (first == 0 || first > file_.size() || row_bytes > (file_.size() - first) / form.height)
    return std::nullopt;
  std::uint64_t expected = first;
  for (std::uint32_t row = 0, strip = 0; row < form.height; ++strip) {
    int fails = 0;
    if (TIFFGetStrileOffsetWithErr(tiff_.get(), strip, &fails) != expected || fails != 0)
      return std::nullopt;
    row += static_cast<std::uint32_t>(std::min<std::uint64_t>(rows, form.height - row));
    expected = first + row * row_bytes;
  }
  return first;
}

TiffResolution TiffFile::resolution() const {
  TiffResolution result;
  result.unit = tag<std::uint16_t>(TIFFTAG_RESOLUTIONUNIT);
  result.x = quotientOf(tag<float>(TIFFTAG_XRESOLUTION));
  result.y = quotientOf(tag<float>(TIFFTAG_YRESOLUTION));
  constexpr std::uint32_t kLsmInfo = 34412;
  std::uint32_t count = 0;
  const void* bytes = nullptr;
  if (TIFFGetField(tiff_.get(), kLsmInfo, &count, &bytes) == 1 && bytes != nullptr)
    result.lsm.assign(static_cast<const char*>(bytes), count);
  return result;
}

void TiffFile::unpack(const TiffPage& page, std::vector<std::byte>& buffer) {
  goTo(page.at);
  const TiffForm& form = page.form;
  if (form != this->form())
    throw unreadable(file_.path(),
                     "it changed since it was opened; run again when nobody writes to it");
  if (tag<std::uint16_t>(TIFFTAG_COMPRESSION) == COMPRESSION_JPEG && form.is_colour)
    TIFFSetField(tiff_.get(), TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
  const std::size_t pixel_bytes = form.samples * storedBytes(*form.type());
  const std::size_t row_bytes = form.width * pixel_bytes;
  buffer.resize(row_bytes * form.height);
  for (std::uint16_t plane = 0; plane < (form.is_separate ? form.samples : 1); ++plane)
    unpackPlane(form, plane, buffer.data());
  // The first row or column of a page may be its last one.
  const auto corner = tag<std::uint16_t>(TIFFTAG_ORIENTATION);
  std::byte* const rows = buffer.data();
  if (corner == ORIENTATION_BOTLEFT || corner == ORIENTATION_BOTRIGHT)
    for (std::size_t y = 0; y < form.height / 2; ++y)
      std::swap_ranges(rows + y * row_bytes, rows + (y + 1) * row_bytes,
                       rows + (form.height - 1 - y) * row_bytes);
  if (corner == ORIENTATION_TOPRIGHT || corner == ORIENTATION_BOTRIGHT)
    for (std::size_t y = 0; y < form.height; ++y)
      for (std::size_t x = 0; x < form.width / 2; ++x) {
        std::byte* const left = rows + y * row_bytes + x * pixel_bytes;
        std::swap_ranges(left, left + pixel_bytes,
                         rows + (y + 1) * row_bytes - (x + 1) * pixel_bytes);
      }
}

// Strips are tiles as wide as the page, of which the last one ends with it.
void TiffFile::unpackPlane(const TiffForm& form, std::uint16_t plane, std::byte* out) {
  const bool has_tiles = TIFFIsTiled(tiff_.get()) != 0;
  const std::uint64_t width = has_tiles ? tag<std::uint32_t>(TIFFTAG_TILEWIDTH) : form.width;
  const std::uint64_t height =
      has_tiles ? tag<std::uint32_t>(TIFFTAG_TILELENGTH)
                : std::min(tag<std::uint32_t>(TIFFTAG_ROWSPERSTRIP), form.height);
  const std::uint64_t numbers = form.is_separate ? 1 : form.samples;
  constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 40, kMostTileBytes = kMostBytes >> 10;
  const std::uint64_t row_bytes = (width * numbers * form.bits + 7) / 8;
  if (width == 0 || height == 0 || row_bytes > kMostBytes / height ||
      (has_tiles &&
       (row_bytes * height > kMostTileBytes || row_bytes * height != TIFFTileSize64(tiff_.get()))))
    throw unreadable(file_.path(),
                     "its tiles have no size that could be; get the whole file again");
  const std::size_t number_bytes = storedBytes(*form.type());
  const std::size_t page_row_bytes = form.width * form.samples * number_bytes;
  const bool is_in_place = !has_tiles && form.bits == 8 * number_bytes && !form.is_separate;
  if (!is_in_place) part_.resize(row_bytes * height);
  for (std::uint64_t y = 0; y < form.height; y += height)
    for (std::uint64_t x = 0; x < form.width; x += width) {
      const std::uint64_t rows = std::min(height, form.height - y);
      const std::uint64_t columns = std::min(width, form.width - x);
      std::byte* const to = out + y * page_row_bytes + (x * form.samples + plane) * number_bytes;
      std::byte* const part = is_in_place ? to : part_.data();
      const auto bytes = static_cast<tmsize_t>(row_bytes * (has_tiles ? height : rows));
      const auto column = static_cast<std::uint32_t>(x), row = static_cast<std::uint32_t>(y);
      const tmsize_t read =
          has_tiles
              ? TIFFReadEncodedTile(
                    tiff_.get(), TIFFComputeTile(tiff_.get(), column, row, 0, plane), part, bytes)
              : TIFFReadEncodedStrip(tiff_.get(), TIFFComputeStrip(tiff_.get(), row, plane), part,
                                     bytes);
      if (read != bytes) throw failed();
      for (std::uint64_t i = 0; !is_in_place && i < rows; ++i)
        placeRow(form, part + i * row_bytes, columns, to + i * page_row_bytes);
    }
}

// `columns` pixels of a tile or a strip to their place in a page.
void TiffFile::placeRow(const TiffForm& form, const std::byte* from, std::uint64_t columns,
                        std::byte* to) {
  const std::size_t number_bytes = storedBytes(*form.type());
  const std::uint64_t numbers = columns * (form.is_separate ? 1 : form.samples);
  if (form.bits < 8 * number_bytes) {
    wide_.resize(numbers * number_bytes);
    const auto widen = number_bytes == 1 ? widenTo<std::uint8_t> : widenTo<std::uint16_t>;
    widen(from, numbers, form.bits, wide_.data());
    from = wide_.data();
  }
  if (!form.is_separate) {
    std::memcpy(to, from, numbers * number_bytes);
    return;
  }
  for (std::uint64_t pixel = 0; pixel < columns; ++pixel)
    std::memcpy(to + pixel * form.samples * number_bytes, from + pixel * number_bytes,
                number_bytes);
}

}  // namespace isobrick
