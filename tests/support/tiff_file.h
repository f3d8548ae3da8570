// TIFF slices for tests.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace isobrick::test {

// A minimal little-endian TIFF: grey, or of colours of three values, each of `bits`.
inline std::string tiffBytes(std::uint32_t width, std::uint32_t height, std::uint16_t bits,
                             const std::string& pixels, std::uint32_t values = 1) {
  std::string bytes = "II*";
  const auto add16 = [&](std::uint32_t v) {
    bytes += static_cast<char>(v & 255);
    bytes += static_cast<char>(v >> 8 & 255);
  };
  const auto add32 = [&](std::uint32_t v) {
    add16(v & 0xffff);
    add16(v >> 16);
  };
  bytes += '\0';
  add32(8);
  const std::vector<std::array<std::uint32_t, 2>> entries = {
      {256, width},
      {257, height},
      {258, bits},
      {259, 1},
      {262, values == 3 ? 2u : 1u},
      {273, 8 + 2 + 9 * 12 + 4},
      {277, values},
      {278, height},
      {279, width * height * values * bits / 8}};
  add16(static_cast<std::uint32_t>(entries.size()));
  for (const auto& [tag, value] : entries) {
    add16(tag);
    add16(4);  // LONG
    add32(1);
    add32(value);
  }
  add32(0);
  return bytes + pixels;
}

// How TiffBuilder writes.
struct TiffForm {
  bool big_endian = false, is_big_tiff = false;
  bool is_packed = false;            // with PackBits, in runs that save nothing
  std::uint32_t rows_per_strip = 7;  // of a picture
  std::uint32_t tile = 0;            // edge of tiles, a multiple of 16; 0: strips
  bool is_separate = false;          // planes of numbers
  std::uint32_t subfile = 0;         // 1: a smaller picture of another page, 2: a page
  std::uint32_t packing = 0;         // said in place of what the numbers are
  std::uint32_t corner = 1;          // where the first row and column are
  std::uint32_t planes = 1;          // that a picture is, one below the other; it is said to be one
};

// The pixels of a picture.
struct TiffPixels {
  std::uint32_t width = 0, height = 0, bytes = 1;  // of a number
  std::uint32_t kind = 1;                          // 1 unsigned, 2 signed, 3 floating
  std::uint32_t samples = 1;                       // numbers of a pixel
  std::string numbers;     // in this machine's order; those of a pixel lie side by side
  std::uint32_t bits = 0;  // of a number, if not all of its bytes: `numbers` are packed rows then
  std::string description = "";
};

// A file of any number of pictures.
class TiffBuilder {
 public:
  explicit TiffBuilder(const TiffForm& form) : form_(form) {
    bytes_ = form.big_endian ? "MM" : "II";
    add(form.is_big_tiff ? 43 : 42, 2);
    if (form.is_big_tiff) add(8, 2);  // bytes of an offset
    if (form.is_big_tiff) add(0, 2);
    link_at_ = bytes_.size();
    add(0, word());
  }

  void addPage(const TiffPixels& pixels) {
    std::vector<std::uint64_t> parts, part_bytes;
    const std::uint32_t across = form_.tile > 0 ? form_.tile : pixels.width;
    const std::uint32_t down = form_.tile > 0 ? form_.tile : form_.rows_per_strip;
    for (std::uint32_t plane = 0; plane < (form_.is_separate ? pixels.samples : 1); ++plane)
      for (std::uint32_t y = 0; y < pixels.height; y += down)
        for (std::uint32_t x = 0; x < pixels.width; x += across) {
          // Tiles are whole, beyond the picture's edge too.
          const std::uint32_t rows = form_.tile > 0 ? down : std::min(down, pixels.height - y);
          std::string part;
          for (std::uint32_t row = y; row < y + rows; ++row)
            part += stored(rowOf(pixels, x, row, across, plane), pixels.bytes);
          parts.push_back(bytes_.size());
          part_bytes.push_back(part.size());
          bytes_ += part;
        }
    const std::uint32_t height = pixels.height / form_.planes;
    if (form_.planes > 1) parts.resize((height - 1) / down + 1);
    part_bytes.resize(parts.size());
    using Entry = std::pair<std::uint32_t, std::vector<std::uint64_t>>;
    const std::vector<std::uint64_t> bits(pixels.samples,
                                          pixels.bits > 0 ? pixels.bits : 8 * pixels.bytes);
    const std::vector<std::uint64_t> kinds(pixels.samples, pixels.kind);
    std::vector<Entry> entries;
    if (form_.subfile > 0) entries.push_back({254, {form_.subfile}});
    entries.insert(entries.end(), {{256, {pixels.width}},
                                   {257, {height}},
                                   {258, bits},
                                   {259,
                                    {form_.packing > 0 ? form_.packing
                                     : form_.is_packed ? 32773u
                                                       : 1u}},
                                   {262, {pixels.samples == 3 ? 2u : 1u}}});
    if (!pixels.description.empty()) {
      const std::string text = pixels.description + std::string(9, '\0');
      entries.push_back({kDescription, {text.begin(), text.end()}});
    }
    if (form_.tile == 0) entries.push_back({273, parts});
    entries.push_back({274, {form_.corner}});
    entries.push_back({277, {pixels.samples}});
    if (form_.tile == 0) entries.push_back({278, {form_.rows_per_strip}});
    if (form_.tile == 0) entries.push_back({279, part_bytes});
    entries.push_back({284, {form_.is_separate ? 2u : 1u}});
    if (form_.tile > 0) {
      entries.push_back({322, {form_.tile}});
      entries.push_back({323, {form_.tile}});
      entries.push_back({324, parts});
      entries.push_back({325, part_bytes});
    }
    entries.push_back({339, kinds});
    addDirectory(entries);
  }

  const std::string& bytes() const { return bytes_; }

 private:
  static constexpr std::uint32_t kDescription = 270;
  std::size_t word() const { return form_.is_big_tiff ? 8 : 4; }
  template <typename Entries>
  void addDirectory(const Entries& entries) {
    constexpr std::uint64_t kText = 2, kLong = 4, kLong8 = 16;
    std::vector<std::uint64_t> places;  // of lists
    for (const auto& entry : entries) {
      places.push_back(bytes_.size());
      if (entry.second.size() > 1)
        for (const std::uint64_t value : entry.second)
          add(value, entry.first == kDescription ? 1 : word());
    }
    put(link_at_, bytes_.size(), word());
    add(entries.size(), form_.is_big_tiff ? 8 : 2);
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const auto& values = entries[i].second;
      add(entries[i].first, 2);
      add(entries[i].first == kDescription ? kText : form_.is_big_tiff ? kLong8 : kLong, 2);
      add(values.size(), word());
      add(values.size() > 1 ? places[i] : values.front(), word());
    }
    link_at_ = bytes_.size();
    add(0, word());
  }
  // `count` pixels from `x` on, zeros beyond the picture.
  std::string rowOf(const TiffPixels& pixels, std::uint32_t x, std::uint32_t y, std::uint32_t count,
                    std::uint32_t plane) const {
    const std::size_t pixel_bytes = std::size_t{pixels.samples} * pixels.bytes;
    const std::size_t packed_bytes = (std::size_t{count} * pixels.samples * pixels.bits + 7) / 8;
    if (pixels.bits > 0) return pixels.numbers.substr(y * packed_bytes, packed_bytes);
    std::string row;
    for (std::uint32_t i = x; i < x + count; ++i) {
      std::string pixel(pixel_bytes, '\0');
      if (i < pixels.width && y < pixels.height)
        pixel =
            pixels.numbers.substr((std::size_t{y} * pixels.width + i) * pixel_bytes, pixel_bytes);
      row +=
          form_.is_separate ? pixel.substr(std::size_t{plane} * pixels.bytes, pixels.bytes) : pixel;
    }
    return row;
  }
  void add(std::uint64_t number, std::size_t bytes) {
    bytes_.append(bytes, '\0');
    put(bytes_.size() - bytes, number, bytes);
  }
  void put(std::size_t at, std::uint64_t number, std::size_t bytes) {
    for (std::size_t i = 0; i < bytes; ++i)
      bytes_[at + (form_.big_endian ? bytes - 1 - i : i)] = static_cast<char>(number >> 8 * i);
  }
  // A row, in the file's byte order and packed.
  std::string stored(std::string row, std::size_t bytes) const {
    if (form_.big_endian)
      for (std::size_t at = 0; at < row.size(); at += bytes)
        std::reverse(row.begin() + static_cast<std::ptrdiff_t>(at),
                     row.begin() + static_cast<std::ptrdiff_t>(at + bytes));
    if (!form_.is_packed) return row;
    std::string packed;
    for (std::size_t at = 0; at < row.size(); at += 128) {
      const std::string run = row.substr(at, 128);
      packed += static_cast<char>(run.size() - 1);
      packed += run;
    }
    return packed;
  }

  TiffForm form_;
  std::string bytes_;
  std::size_t link_at_ = 0;
};

}  // namespace isobrick::test
