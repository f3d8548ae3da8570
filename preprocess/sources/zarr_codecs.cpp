#include <blosc.h>
#include <zlib.h>
#include <zstd.h>

#include <array>
#include <cstring>

#include "isobrick/preprocess/sources/zarr_array.h"

namespace isobrick {
namespace {

std::string wrongSize(std::size_t expected) {
  return "it does not unpack to the " + std::to_string(expected) + " bytes of a chunk";
}

std::string unpackBlosc(std::span<const std::byte> packed, std::span<std::byte> out) {
  if (packed.size() < BLOSC_MIN_HEADER_LENGTH) return "it is cut short";
  const auto* const header = reinterpret_cast<const unsigned char*>(packed.data());
  std::size_t bytes = 0;
  if (header[0] != BLOSC_VERSION_FORMAT) return "it is of an unknown version of Blosc";
  if (blosc_cbuffer_validate(packed.data(), packed.size(), &bytes) != 0)
    return "it is cut short or damaged";
  if (bytes != out.size()) return wrongSize(out.size());
  // The decoder of BloscLZ trusts its input (c-blosc issue 405). Snappy is in no Debian build.
  const int codec = header[2] >> 5;
  const bool is_plain = (header[2] & 0x2) != 0;  // copied
  if (!is_plain && codec != BLOSC_LZ4_FORMAT && codec != BLOSC_ZLIB_FORMAT &&
      codec != BLOSC_ZSTD_FORMAT)
    return codec == BLOSC_BLOSCLZ_FORMAT
               ? "BloscLZ is not read, its decoder being unsafe; write it with lz4 or zstd"
               : "it is packed with an unknown codec of Blosc";
  const int got = blosc_decompress_ctx(packed.data(), out.data(), out.size(), 1);
  return got == static_cast<int>(out.size()) ? std::string() : "it is damaged";
}

std::string inflateAll(std::span<const std::byte> packed, std::span<std::byte> out) {
  z_stream stream = {};
  constexpr int kZlibOrGzip = 15 + 32;
  if (inflateInit2(&stream, kZlibOrGzip) != Z_OK) return "there is no memory to unpack it";
  stream.next_in =
      const_cast<unsigned char*>(reinterpret_cast<const unsigned char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<unsigned char*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int result = inflate(&stream, Z_FINISH);
  const bool is_whole = result == Z_STREAM_END && stream.avail_out == 0;
  inflateEnd(&stream);
  if (is_whole) return {};
  return result == Z_DATA_ERROR ? "it is damaged" : wrongSize(out.size());
}

}  // namespace

std::string unpackZarr(ZarrCodec codec, std::span<const std::byte> packed,
                       std::span<std::byte> out) {
  switch (codec) {
    case ZarrCodec::kNone:
      if (packed.size() != out.size()) return wrongSize(out.size());
      std::memcpy(out.data(), packed.data(), out.size());
      return {};
    case ZarrCodec::kBlosc:
      return unpackBlosc(packed, out);
    case ZarrCodec::kZlib:
    case ZarrCodec::kGzip:
      return inflateAll(packed, out);
    case ZarrCodec::kZstd: {
      const std::size_t got = ZSTD_decompress(out.data(), out.size(), packed.data(), packed.size());
      if (ZSTD_isError(got)) return "it is damaged";
      return got == out.size() ? std::string() : wrongSize(out.size());
    }
  }
  return "it is packed in an unknown way";
}

std::uint64_t mostPackedBytes(std::uint64_t bytes) { return bytes + bytes / 16 + (1 << 16); }

std::uint32_t crc32c(std::span<const std::byte> bytes) {
  static constexpr auto kTable = [] {
    std::array<std::uint32_t, 256> table{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      std::uint32_t value = i;
      for (int bit = 0; bit < 8; ++bit)
        value = (value & 1u) != 0 ? value >> 1 ^ 0x82f63b78u : value >> 1;
      table[i] = value;
    }
    return table;
  }();
  std::uint32_t crc = ~0u;
  for (const std::byte byte : bytes)
    crc = crc >> 8 ^ kTable[(crc ^ static_cast<std::uint32_t>(byte)) & 0xffu];
  return ~crc;
}

}  // namespace isobrick
