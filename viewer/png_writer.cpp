// PNG (ISO/IEC 15948): rows are filtered and packed in strips that know nothing of each other, so
// that all processors work; together they are one stream of zlib's.
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <future>
#include <limits>
#include <string>
#include <thread>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/picture_writer.h"

namespace isobrick {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kStripBytes = std::size_t{1} << 20;  // of rows, about

// ---------------------------------------------------------------------------------------- colours

// toSrgb8() by a table: the last of the greatest values below each bucket of floats, then the next.
class Srgb8Table {
 public:
  Srgb8Table() {
    least_[0] = 0.0f;
    for (unsigned value = 1; value < 256; ++value) least_[value] = leastOf(value);
    least_[256] = std::numeric_limits<float>::infinity();
    for (std::uint32_t bucket = 0; bucket < first_.size(); ++bucket)
      first_[bucket] = toSrgb8(std::bit_cast<float>(bucket << kShift));
  }
  std::uint8_t operator()(float linear) const {
    if (!(linear > 0.0f)) return 0;
    if (linear >= 1.0f) return 255;
    unsigned value = first_[std::bit_cast<std::uint32_t>(linear) >> kShift];
    while (linear >= least_[value + 1]) ++value;
    return static_cast<std::uint8_t>(value);
  }

 private:
  static constexpr unsigned kShift = 16;
  // The least float that is at least this value; floats above 0 are ordered as their bits.
  static float leastOf(unsigned value) {
    std::uint32_t below = 0, from = std::bit_cast<std::uint32_t>(1.0f);
    while (from - below > 1) {
      const std::uint32_t middle = below + (from - below) / 2;
      (toSrgb8(std::bit_cast<float>(middle)) >= value ? from : below) = middle;
    }
    return std::bit_cast<float>(from);
  }

  std::array<float, 257> least_{};
  std::array<std::uint8_t, (0x3f800000u >> kShift) + 1> first_{};
};

// PNG stores colours that are not premultiplied, and alpha beside them.
void appendPixels(const Image& image, std::size_t first, std::size_t count, Bytes& bytes) {
  static const Srgb8Table srgb8;
  const std::size_t before = bytes.size();
  bytes.resize(before + (image.alpha.empty() ? 3 : 4) * count);
  std::uint8_t* to = bytes.data() + before;
  for (std::size_t i = first; i < first + count; ++i) {
    const float* const rgb = image.rgb.data() + 3 * i;
    if (image.alpha.empty()) {
      for (std::size_t c = 0; c < 3; ++c) *to++ = srgb8(rgb[c]);
      continue;
    }
    const float alpha = std::clamp(image.alpha[i], 0.0f, 1.0f);
    for (std::size_t c = 0; c < 3; ++c) *to++ = alpha > 0.0f ? srgb8(rgb[c] / alpha) : 0;
    *to++ = static_cast<std::uint8_t>(std::lround(255.0f * alpha));
  }
}

// ----------------------------------------------------------------------------------------- strips

int paeth(int left, int above, int corner) {
  const int p = left + above - corner;
  const int to_left = std::abs(p - left), to_above = std::abs(p - above);
  const int to_corner = std::abs(p - corner);
  if (to_left <= to_above && to_left <= to_corner) return left;
  return to_above <= to_corner ? above : corner;
}

// The row by the filter (0 .. 4, section 9) of which the bytes are smallest as signed numbers.
class RowFilter {
 public:
  RowFilter(std::size_t row_bytes, std::size_t pixel_bytes)
      : row_bytes_(row_bytes), pixel_bytes_(pixel_bytes) {
    for (Bytes& row : filtered_) row.resize(row_bytes);
  }

  void append(const std::uint8_t* row, const std::uint8_t* above, Bytes& to) {
    for (std::size_t i = 0; i < row_bytes_; ++i) {
      const bool first = i < pixel_bytes_;
      const int x = row[i], a = first ? 0 : row[i - pixel_bytes_], b = above[i];
      const int c = first ? 0 : above[i - pixel_bytes_];
      filtered_[0][i] = static_cast<std::uint8_t>(x);
      filtered_[1][i] = static_cast<std::uint8_t>(x - a);
      filtered_[2][i] = static_cast<std::uint8_t>(x - b);
      filtered_[3][i] = static_cast<std::uint8_t>(x - (a + b) / 2);
      filtered_[4][i] = static_cast<std::uint8_t>(x - paeth(a, b, c));
    }
    std::size_t best = 0;
    std::uint64_t least = sizeOf(filtered_[0]);
    for (std::size_t filter = 1; filter < filtered_.size(); ++filter) {
      const std::uint64_t size = sizeOf(filtered_[filter]);
      if (size >= least) continue;
      least = size;
      best = filter;
    }
    to.push_back(static_cast<std::uint8_t>(best));
    to.insert(to.end(), filtered_[best].begin(), filtered_[best].end());
  }

 private:
  static std::uint64_t sizeOf(const Bytes& row) {
    std::uint64_t sum = 0;
    for (const std::uint8_t byte : row)
      sum += static_cast<unsigned>(std::min<int>(byte, 256 - byte));
    return sum;
  }

  std::size_t row_bytes_, pixel_bytes_;
  std::array<Bytes, 5> filtered_;
};

struct PackedStrip {
  Bytes packed;               // blocks of deflate's, up to a whole byte
  uLong checksum = 0;         // Adler-32 of the bytes before
  std::size_t raw_bytes = 0;  // so many
};

PackedStrip packed(const Bytes& raw, bool last) {
  PackedStrip strip;
  strip.checksum = adler32_z(adler32_z(0, nullptr, 0), raw.data(), raw.size());
  strip.raw_bytes = raw.size();
  z_stream stream{};
  constexpr int kNoHeader = -15, kMemoryLevel = 8;
  if (deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, kNoHeader, kMemoryLevel,
                   Z_FILTERED) != Z_OK)
    throw Error("cannot encode a PNG picture: no memory; try a smaller picture");
  constexpr uLong kFlushBytes = 64;
  strip.packed.resize(deflateBound(&stream, static_cast<uLong>(raw.size())) + kFlushBytes);
  stream.next_in = const_cast<Bytef*>(raw.data());  // only reads
  stream.avail_in = static_cast<uInt>(raw.size());
  stream.next_out = strip.packed.data();
  stream.avail_out = static_cast<uInt>(strip.packed.size());
  const int result = deflate(&stream, last ? Z_FINISH : Z_SYNC_FLUSH);
  strip.packed.resize(strip.packed.size() - stream.avail_out);
  deflateEnd(&stream);
  if (result != (last ? Z_STREAM_END : Z_OK) || stream.avail_in != 0)
    throw Error("cannot encode a PNG picture: zlib failed");
  return strip;
}

// ---------------------------------------------------------------------------------------- the file

void appendBigEndian(std::uint32_t value, Bytes& bytes) {
  for (const unsigned shift : {24u, 16u, 8u, 0u})
    bytes.push_back(static_cast<std::uint8_t>(value >> shift & 0xff));
}

class PngEncoder : public BandEncoder {
 public:
  PngEncoder(const PictureShape& shape, WriteAt write)
      : shape_(shape),
        write_(std::move(write)),
        pixel_bytes_(shape.alpha ? 4 : 3),
        row_bytes_(pixel_bytes_ * static_cast<std::size_t>(shape.width)),
        strip_rows_(std::max<std::size_t>(1, kStripBytes / row_bytes_)),
        above_(row_bytes_) {
    assert(shape.width > 0 && shape.height > 0);
    begin();
  }

  void add(const Image& rows) override {
    assert(rows.width == shape_.width && rows.alpha.empty() != shape_.alpha);
    assert(rows_ + static_cast<std::size_t>(rows.height) <=
           static_cast<std::size_t>(shape_.height));
    const auto width = static_cast<std::size_t>(shape_.width);
    const auto count = static_cast<std::size_t>(rows.height);
    for (std::size_t row = 0; row < count;) {
      const std::size_t taken = std::min(count - row, strip_rows_ - strip_.size() / row_bytes_);
      appendPixels(rows, row * width, taken * width, strip_);
      row += taken;
      rows_ += taken;
      const bool last = rows_ == static_cast<std::size_t>(shape_.height);
      if (last || strip_.size() == strip_rows_ * row_bytes_) sendStrip(last);
    }
  }

  void finish() override {
    assert(rows_ == static_cast<std::size_t>(shape_.height));
    while (!strips_.empty()) writeStrip();
    Bytes end;
    appendBigEndian(static_cast<std::uint32_t>(checksum_), end);
    writeChunk("IDAT", end);
    writeChunk("IEND", {});
  }

 private:
  void begin() {
    static constexpr std::array<std::uint8_t, 8> kSignature{0x89, 'P',  'N',  'G',
                                                            '\r', '\n', 0x1a, '\n'};
    write(kSignature.data(), kSignature.size());
    Bytes header;
    appendBigEndian(static_cast<std::uint32_t>(shape_.width), header);
    appendBigEndian(static_cast<std::uint32_t>(shape_.height), header);
    // 8 bits; RGB or RGBA; deflate; the five filters; not interlaced.
    for (const int byte : {8, shape_.alpha ? 6 : 2, 0, 0, 0})
      header.push_back(static_cast<std::uint8_t>(byte));
    writeChunk("IHDR", header);
    writeChunk("sRGB", {0});  // perceptual
    if (shape_.pixels_per_inch > 0.0) {
      const auto per_metre =
          static_cast<std::uint32_t>(std::lround(shape_.pixels_per_inch / 0.0254));
      Bytes size;
      appendBigEndian(per_metre, size);
      appendBigEndian(per_metre, size);
      size.push_back(1);  // the unit is the metre
      writeChunk("pHYs", size);
    }
    writeChunk("IDAT", {0x78, 0x9c});  // zlib: a window of 32 KiB, the default level
  }

  void sendStrip(bool last) {
    const unsigned most = std::max(1u, std::thread::hardware_concurrency());
    if (strips_.size() >= most) writeStrip();
    Bytes strip = std::exchange(strip_, {}), above(row_bytes_);
    std::copy(strip.end() - static_cast<std::ptrdiff_t>(row_bytes_), strip.end(), above.begin());
    above.swap(above_);
    strips_.push_back(
        std::async(std::launch::async, [strip = std::move(strip), above = std::move(above),
                                        row_bytes = row_bytes_, pixel_bytes = pixel_bytes_, last] {
          RowFilter filter(row_bytes, pixel_bytes);
          Bytes filtered;
          filtered.reserve(strip.size() + strip.size() / row_bytes);
          for (std::size_t at = 0; at < strip.size(); at += row_bytes)
            filter.append(strip.data() + at, at == 0 ? above.data() : strip.data() + at - row_bytes,
                          filtered);
          return packed(filtered, last);
        }));
  }

  void writeStrip() {
    const PackedStrip strip = strips_.front().get();
    strips_.pop_front();
    checksum_ = adler32_combine(checksum_, strip.checksum, static_cast<z_off_t>(strip.raw_bytes));
    writeChunk("IDAT", strip.packed);
  }

  void writeChunk(const char* type, const Bytes& content) {
    Bytes chunk;
    chunk.reserve(content.size() + 12);
    appendBigEndian(static_cast<std::uint32_t>(content.size()), chunk);
    chunk.insert(chunk.end(), type, type + 4);
    chunk.insert(chunk.end(), content.begin(), content.end());
    appendBigEndian(static_cast<std::uint32_t>(crc32_z(0, chunk.data() + 4, chunk.size() - 4)),
                    chunk);
    write(chunk.data(), chunk.size());
  }

  void write(const void* data, std::size_t bytes) {
    write_(data, bytes, written_);
    written_ += bytes;
  }

  const PictureShape shape_;
  const WriteAt write_;
  const std::size_t pixel_bytes_, row_bytes_, strip_rows_;
  Bytes strip_, above_;  // rows for the next strip, and the one before them
  std::size_t rows_ = 0;
  std::deque<std::future<PackedStrip>> strips_;
  uLong checksum_ = 1;  // Adler-32 of nothing
  std::uint64_t written_ = 0;
};

}  // namespace

std::unique_ptr<BandEncoder> makePngEncoder(const PictureShape& shape, WriteAt write) {
  return std::make_unique<PngEncoder>(shape, std::move(write));
}

}  // namespace isobrick
