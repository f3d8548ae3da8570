#include "isobrick/preprocess/sources/unpack_block.h"

#include <blosc.h>
#include <bzlib.h>
#include <lz4.h>
#include <lzma.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"

namespace isobrick {
namespace {

std::string wrongSize(std::size_t expected) {
  return concat("it does not unpack to the ", expected, " bytes of a chunk");
}

// The decoder of BloscLZ adds up the bytes of 255 that lengthen a run in an int, which overflows
// after 8.4 million of them (c-blosc issue 405); all else it checks. No block of a chunk is as
// long.
bool overflowsBloscLz(std::span<const std::byte> packed) {
  constexpr std::ptrdiff_t kTooMany = 8 << 20;
  for (auto at = packed.begin(); packed.end() - at >= kTooMany;) {
    const auto end =
        std::find_if(at, packed.end(), [](std::byte b) { return b != std::byte{255}; });
    if (end - at >= kTooMany) return true;
    at = std::find(end, packed.end(), std::byte{255});
  }
  return false;
}

std::string unpackBlosc(std::span<const std::byte> packed, std::span<std::byte> out) {
  if (packed.size() < BLOSC_MIN_HEADER_LENGTH) return "it is cut short";
  const auto* const header = reinterpret_cast<const unsigned char*>(packed.data());
  std::size_t bytes = 0;
  if (header[0] != BLOSC_VERSION_FORMAT) return "it is of an unknown version of Blosc";
  if (blosc_cbuffer_validate(packed.data(), packed.size(), &bytes) != 0)
    return "it is cut short or damaged";
  if (bytes != out.size()) return wrongSize(out.size());
  const int codec = header[2] >> 5;
  const bool is_plain = (header[2] & 0x2) != 0;  // copied
  // Snappy is in no Debian build.
  if (!is_plain && codec != BLOSC_BLOSCLZ_FORMAT && codec != BLOSC_LZ4_FORMAT &&
      codec != BLOSC_ZLIB_FORMAT && codec != BLOSC_ZSTD_FORMAT)
    return "it is packed with an unknown codec of Blosc";
  if (codec == BLOSC_BLOSCLZ_FORMAT && overflowsBloscLz(packed)) return "it is damaged";
  const int got = blosc_decompress_ctx(packed.data(), out.data(), out.size(), 1);
  return got == static_cast<int>(out.size()) ? std::string() : "it is damaged";
}

// `window`: that of zlib, which says what is in front of the data, too.
std::string inflateBlock(int window, std::span<const std::byte> packed, std::span<std::byte> out) {
  z_stream stream = {};
  if (inflateInit2(&stream, window) != Z_OK) return "there is no memory to unpack it";
  Bytef none{};
  stream.next_in =
      const_cast<unsigned char*>(reinterpret_cast<const unsigned char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = out.empty() ? &none : reinterpret_cast<unsigned char*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int result = inflate(&stream, Z_FINISH);
  const bool is_whole = result == Z_STREAM_END && stream.avail_out == 0;
  inflateEnd(&stream);
  if (is_whole) return {};
  return result == Z_DATA_ERROR ? "it is damaged" : wrongSize(out.size());
}

std::string unpackLz4(std::span<const std::byte> packed, std::span<std::byte> out) {
  const int got = LZ4_decompress_safe(
      reinterpret_cast<const char*>(packed.data()), reinterpret_cast<char*>(out.data()),
      static_cast<int>(packed.size()), static_cast<int>(out.size()));
  return got == static_cast<int>(out.size()) ? std::string() : "it is damaged";
}

std::string unpackBz2(std::span<const std::byte> packed, std::span<std::byte> out) {
  auto bytes = static_cast<unsigned>(out.size());
  const int result =
      BZ2_bzBuffToBuffDecompress(reinterpret_cast<char*>(out.data()), &bytes,
                                 const_cast<char*>(reinterpret_cast<const char*>(packed.data())),
                                 static_cast<unsigned>(packed.size()), 0, 0);
  if (result == BZ_OK) return bytes == out.size() ? std::string() : wrongSize(out.size());
  return result == BZ_OUTBUFF_FULL ? wrongSize(out.size()) : "it is damaged";
}

// .xz and .lzma; a stream without a head is refused as damaged.
std::string unpackLzma(std::span<const std::byte> packed, std::span<std::byte> out) {
  constexpr std::uint64_t kMostMemory = std::uint64_t{128} << 20;  // level 9 takes 65 MiB
  lzma_stream stream = LZMA_STREAM_INIT;
  if (lzma_auto_decoder(&stream, kMostMemory, 0) != LZMA_OK)
    return "there is no memory to unpack it";
  stream.next_in = reinterpret_cast<const std::uint8_t*>(packed.data());
  stream.avail_in = packed.size();
  stream.next_out = reinterpret_cast<std::uint8_t*>(out.data());
  stream.avail_out = out.size();
  const lzma_ret result = lzma_code(&stream, LZMA_FINISH);
  const bool is_whole = result == LZMA_STREAM_END && stream.avail_out == 0;
  lzma_end(&stream);
  if (is_whole) return {};
  if (result == LZMA_MEMLIMIT_ERROR) return "its LZMA takes more than 128 MiB to unpack";
  return result == LZMA_OK || result == LZMA_BUF_ERROR ? wrongSize(out.size()) : "it is damaged";
}

}  // namespace

std::uint64_t mostUnpackedBytes(BlockCodec codec, std::uint64_t packed_bytes) {
  const std::uint64_t ratio = codec == BlockCodec::kZlib || codec == BlockCodec::kDeflate ? 1032
                              : codec == BlockCodec::kLz4                                 ? 255
                                                                                          : 1 << 14;
  return std::min(packed_bytes, std::uint64_t{1} << 40) * ratio;
}

std::string unpackBlock(BlockCodec codec, std::span<const std::byte> packed,
                        std::span<std::byte> out) {
  switch (codec) {
    case BlockCodec::kNone:
      if (packed.size() != out.size()) return wrongSize(out.size());
      std::copy(packed.begin(), packed.end(), out.begin());
      return {};
    case BlockCodec::kBlosc:
      return unpackBlosc(packed, out);
    case BlockCodec::kZlib:
      return inflateBlock(MAX_WBITS + 32, packed, out);
    case BlockCodec::kDeflate:
      return inflateBlock(-MAX_WBITS, packed, out);
    case BlockCodec::kSizedLz4:
      if (packed.size() < 4) return "it is cut short";
      if (loadNumber<std::uint32_t>(packed.data(), false) != out.size())
        return wrongSize(out.size());
      return unpackLz4(packed.subspan(4), out);
    case BlockCodec::kLz4:
      return unpackLz4(packed, out);
    case BlockCodec::kBz2:
      return unpackBz2(packed, out);
    case BlockCodec::kLzma:
      return unpackLzma(packed, out);
    case BlockCodec::kZstd: {
      const std::size_t got = ZSTD_decompress(out.data(), out.size(), packed.data(), packed.size());
      if (ZSTD_isError(got)) return "it is damaged";
      return got == out.size() ? std::string() : wrongSize(out.size());
    }
  }
  return "it is packed in an unknown way";
}

}  // namespace isobrick
