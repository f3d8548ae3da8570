#include "isobrick/storage/brick_encoder.h"

#include <blosc.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "isobrick/storage/checksum.h"

namespace isobrick {
namespace {

static_assert(kMostPackedBytes == BLOSC_MAX_BUFFERSIZE);

// ---- which parameters; docs/lab.md has those that were tried ----

struct BloscSetting {
  const char* compressor;
  int level;
  std::size_t block_bytes;  // Blosc multiplies it by the element's bytes if it splits a block
};
// LZ4 is there for speed: level 5 saves at most 2 % more and takes 3 to 15 % longer. Its blocks
// stay in the second-level cache.
constexpr BloscSetting kLz4Setting = {BLOSC_LZ4_COMPNAME, 3, 128 * 1024};
// Blosc's level 2 is level 3 of Zstandard: up to twice the time, for nothing or a few per cent.
constexpr BloscSetting kZstdSetting = {BLOSC_ZSTD_COMPNAME, 1, 256 * 1024};

// How the elements of a part are packed: as numbers of this many bytes, whose bytes are shuffled;
// or as single bytes, as they are.
struct ElementView {
  std::size_t bytes;
  bool shuffled;
};
// Shuffling the three codes of a node apart gains nothing.
constexpr ElementView kCodesView = {1, false};

// ---- differences, before the shuffle of Zstandard parts (docs/FORMAT.md, section 5) ----

// Elements that are copied aside at a time, so that the codes can take their place.
constexpr std::size_t kChunk = 1024;

// data[i] becomes the zigzag code of data[i] - data[i - 1]: 0, -1, 1, -2 are coded as 0, 1, 2, 3.
// `bytes` is a multiple of the element's.
template <typename T>
void makeDifferences(std::byte* data, std::size_t bytes) {
  std::array<T, kChunk + 1> before;
  std::array<T, kChunk> codes;
  before[0] = 0;
  const std::size_t count = bytes / sizeof(T);
  for (std::size_t first = 0; first < count; first += kChunk) {
    const std::size_t size = std::min(kChunk, count - first);
    std::memcpy(before.data() + 1, data + first * sizeof(T), size * sizeof(T));
    for (std::size_t i = 0; i < size; ++i) {
      const T difference = static_cast<T>(before[i + 1] - before[i]);
      const T sign = static_cast<T>(-static_cast<T>(difference >> (8 * sizeof(T) - 1)));
      codes[i] = static_cast<T>(static_cast<T>(difference << 1) ^ sign);
    }
    std::memcpy(data + first * sizeof(T), codes.data(), size * sizeof(T));
    before[0] = before[size];
  }
}

template <typename T>
T differenceOf(T code) {
  return static_cast<T>(static_cast<T>(code >> 1) ^ static_cast<T>(-static_cast<T>(code & 1)));
}

// 16 bytes as lanes of T. A running sum one by one would add half of the time that Zstandard takes.
template <typename T>
struct Lanes {
  static constexpr int kCount = 16 / sizeof(T);
  typedef T Vector __attribute__((vector_size(16)));
  using Indices = std::make_integer_sequence<int, kCount>;

  // The lanes moved up by kBy, zeros below.
  template <int kBy, int... kLane>
  static Vector movedUp(Vector v, std::integer_sequence<int, kLane...>) {
    return __builtin_shufflevector(Vector{}, v, (kLane < kBy ? 0 : kCount + kLane - kBy)...);
  }
  // Every lane plus all lanes below it.
  template <int kBy = 1>
  static Vector runningSum(Vector v) {
    if constexpr (kBy < kCount)
      return runningSum<2 * kBy>(v + movedUp<kBy>(v, Indices{}));
    else
      return v;
  }
  template <int... kLane>
  static Vector lastInAll(Vector v, std::integer_sequence<int, kLane...>) {
    return __builtin_shufflevector(v, v, (0 * kLane + kCount - 1)...);
  }
};

// The inverse of makeDifferences().
template <typename T>
void undoDifferences(std::byte* data, std::size_t bytes) {
  using L = Lanes<T>;
  typename L::Vector last = {};
  std::size_t at = 0;
  for (; bytes - at >= 16; at += 16) {
    typename L::Vector v;
    std::memcpy(&v, data + at, 16);
    v = L::runningSum((v >> 1) ^ -(v & 1)) + last;
    std::memcpy(data + at, &v, 16);
    last = L::lastInAll(v, typename L::Indices{});
  }
  T sum = last[0];
  for (; at < bytes; at += sizeof(T)) {
    T code;
    std::memcpy(&code, data + at, sizeof code);
    sum = static_cast<T>(sum + differenceOf(code));
    std::memcpy(data + at, &sum, sizeof sum);
  }
}

// Calls f with an unsigned integer of `bytes` bytes: 1, 2, 4 or 8.
template <typename F>
void visitUnsigned(std::size_t bytes, F&& f) {
  if (bytes == 1) f(std::uint8_t{});
  if (bytes == 2) f(std::uint16_t{});
  if (bytes == 4) f(std::uint32_t{});
  if (bytes == 8) f(std::uint64_t{});
}

void makeDifferences(std::byte* data, std::size_t bytes, std::size_t element_bytes) {
  visitUnsigned(element_bytes, [&](auto t) { makeDifferences<decltype(t)>(data, bytes); });
}
void undoDifferences(std::byte* data, std::size_t bytes, std::size_t element_bytes) {
  visitUnsigned(element_bytes, [&](auto t) { undoDifferences<decltype(t)>(data, bytes); });
}

// ---- packing ----

// True if all elements of `element_bytes` bytes are the same.
bool allEqual(std::span<const std::byte> data, std::size_t element_bytes) {
  return data.size() <= element_bytes ||
         std::memcmp(data.data(), data.data() + element_bytes, data.size() - element_bytes) == 0;
}

void leaveOut(EncodedPart& part, format::Codec codec) {
  part.bytes.clear();
  part.checksum = 0;
  part.codec = codec;
}

// Replaces the bytes by their Blosc buffer. False, with the bytes unchanged, if it does not save
// enough: plain bytes need no buffer of their own when they are read, and no time.
bool pack(EncodedPart& part, format::Codec codec, const ElementView& view,
          std::vector<std::byte>& scratch) {
  const std::size_t bytes = part.bytes.size();
  if (bytes == 0 || bytes > kMostPackedBytes) return false;
  const std::size_t most = bytes - bytes / 16 - 1;
  if (scratch.size() < most) scratch.resize(most);
  const bool has_differences = codec == format::Codec::kZstd && view.shuffled;
  if (has_differences) makeDifferences(part.bytes.data(), bytes, view.bytes);
  const BloscSetting& setting = codec == format::Codec::kZstd ? kZstdSetting : kLz4Setting;
  const int packed = blosc_compress_ctx(
      setting.level, view.shuffled ? BLOSC_SHUFFLE : BLOSC_NOSHUFFLE, view.bytes, bytes,
      part.bytes.data(), scratch.data(), most, setting.compressor, setting.block_bytes, 1);
  if (packed <= 0) {
    if (has_differences) undoDifferences(part.bytes.data(), bytes, view.bytes);
    return false;
  }
  part.bytes.resize(static_cast<std::size_t>(packed));
  std::memcpy(part.bytes.data(), scratch.data(), part.bytes.size());
  return true;
}

void store(EncodedPart& part, format::Codec codec, const ElementView& view,
           std::vector<std::byte>& scratch) {
  const bool stays = codec == format::Codec::kStored || codec == format::Codec::kInSource;
  part.codec = stays || pack(part, codec, view, scratch) ? codec : format::Codec::kStored;
  part.checksum = checksum64(part.bytes.data(), part.bytes.size());
}

// ---- unpacking: a file is hostile ----

// The 16 bytes that every Blosc buffer begins with.
struct BloscHeader {
  std::uint8_t version;
  std::uint8_t compressor_version;
  std::uint8_t flags;
  std::uint8_t element_bytes;
  std::uint32_t bytes;  // unpacked
  std::uint32_t block_bytes;
  std::uint32_t packed_bytes;  // of the buffer as a whole
};
static_assert(sizeof(BloscHeader) == BLOSC_MIN_HEADER_LENGTH);

constexpr unsigned kDoNotSplit = 0x10;
constexpr int kCompressorShift = 5;
// Blosc takes twice a block's bytes, and a little, from the heap and does not check the result.
constexpr std::uint32_t kMostBlockBytes = 1 << 20;
// Many small blocks take long: Zstandard sets itself up for each.
constexpr std::uint32_t kLeastBlockBytes = 128;
// Blosc splits a block only if each split has this many bytes.
constexpr std::uint32_t kLeastSplitBytes = 128;

// Checks it against the format. Blosc's own compressor, BloscLZ, is refused: its decoder adds up
// lengths without a check for overflow (c-blosc issue 405).
bool isHeaderSound(const BloscHeader& header, format::Codec codec, std::size_t stored_bytes,
                   std::size_t bytes) {
  const unsigned compressor = codec == format::Codec::kZstd ? BLOSC_ZSTD_FORMAT : BLOSC_LZ4_FORMAT;
  const unsigned flags = compressor << kCompressorShift;
  const std::uint32_t element = header.element_bytes;
  return header.version == BLOSC_VERSION_FORMAT &&
         header.compressor_version == (codec == format::Codec::kZstd ? BLOSC_ZSTD_VERSION_FORMAT
                                                                     : BLOSC_LZ4_VERSION_FORMAT) &&
         (header.flags & ~(BLOSC_DOSHUFFLE | kDoNotSplit)) == flags &&
         (element == 1 || element == 2 || element == 4 || element == 8) &&
         header.packed_bytes == stored_bytes && header.bytes == bytes && bytes % element == 0 &&
         header.block_bytes % element == 0 && header.block_bytes > 0 &&
         header.block_bytes >= std::min<std::size_t>(kLeastBlockBytes, bytes) &&
         header.block_bytes <= std::min<std::size_t>(kMostBlockBytes, bytes);
}

std::uint32_t numberAt(std::span<const std::byte> data, std::size_t at) {
  std::uint32_t number;
  std::memcpy(&number, data.data() + at, sizeof number);
  return number;
}

// Checks that the blocks lie one after the other and fill the buffer, as they are written. Blosc
// itself would read any bytes of the buffer for any block, the same ones a million times.
bool areBlocksSound(const BloscHeader& header, std::span<const std::byte> stored) {
  const std::size_t blocks =
      (header.bytes + std::size_t{header.block_bytes} - 1) / header.block_bytes;
  if (blocks > (stored.size() - sizeof header) / 4) return false;
  std::size_t at = sizeof header + 4 * blocks;
  for (std::size_t block = 0; block < blocks; ++block) {
    if (numberAt(stored, sizeof header + 4 * block) != at) return false;
    const std::size_t block_bytes =
        std::min<std::size_t>(header.block_bytes, header.bytes - block * header.block_bytes);
    const bool is_split = (header.flags & kDoNotSplit) == 0 && block_bytes == header.block_bytes &&
                          block_bytes / header.element_bytes >= kLeastSplitBytes;
    const std::size_t splits = is_split ? header.element_bytes : 1;
    for (std::size_t split = 0; split < splits; ++split) {
      if (stored.size() - at < 4) return false;
      const std::size_t split_bytes = numberAt(stored, at);
      at += 4;
      if (split_bytes > block_bytes / splits || split_bytes > stored.size() - at) return false;
      at += split_bytes;
    }
  }
  return at == stored.size();
}

bool unpack(format::Codec codec, std::span<const std::byte> stored, std::size_t bytes,
            std::byte* out) {
  BloscHeader header;
  if (stored.size() <= sizeof header || bytes > kMostPackedBytes) return false;
  std::memcpy(&header, stored.data(), sizeof header);
  if (!isHeaderSound(header, codec, stored.size(), bytes) || !areBlocksSound(header, stored) ||
      blosc_decompress_ctx(stored.data(), out, bytes, 1) != static_cast<int>(bytes))
    return false;
  if (codec == format::Codec::kZstd && (header.flags & BLOSC_DOSHUFFLE) != 0)
    undoDifferences(out, bytes, header.element_bytes);
  return true;
}

}  // namespace

void encodeBrick(VoxelType type, format::Codec codec, EncodedBrick& brick) {
  const std::size_t voxel = voxelBytes(type);
  const bool is_constant = allEqual(brick.samples.bytes, voxel);
  brick.constant = 0;
  if (is_constant)
    brick.constant = visitVoxelType(type, [&](auto tag) {
      typename decltype(tag)::Type value;
      std::memcpy(&value, brick.samples.bytes.data(), sizeof value);
      return static_cast<float>(value);
    });
  // Ranges of a constant brick may still be wider: coarser samples on its surface are averages with
  // voxels outside of it.
  const bool has_constant_ranges =
      is_constant && allEqual(brick.ranges.bytes, voxel) &&
      std::memcmp(brick.ranges.bytes.data(), brick.samples.bytes.data(), voxel) == 0;
  if (has_constant_ranges)
    leaveOut(brick.ranges, format::Codec::kConstant);
  else
    store(brick.ranges, codec, {2 * voxel, true}, brick.scratch);
  if (is_constant)
    leaveOut(brick.samples, format::Codec::kConstant);
  else if (brick.is_in_source)
    store(brick.samples, format::Codec::kInSource, {voxel, true}, brick.scratch);
  else
    store(brick.samples, codec, {voxel, true}, brick.scratch);
  if (brick.curvature.bytes.empty())
    leaveOut(brick.curvature, format::Codec::kAbsent);
  else if (brick.curvature.bytes[0] == std::byte{0} && allEqual(brick.curvature.bytes, 1))
    leaveOut(brick.curvature, format::Codec::kConstant);
  else
    store(brick.curvature, codec, kCodesView, brick.scratch);
}

void encodeNumbers(std::size_t element_bytes, format::Codec codec, EncodedPart& part) {
  std::vector<std::byte> scratch;
  store(part, codec, {element_bytes, true}, scratch);
}

bool decodePart(format::Codec codec, std::span<const std::byte> stored, std::size_t bytes,
                std::byte* out) {
  switch (codec) {
    case format::Codec::kStored:
      if (stored.size() != bytes) return false;
      if (bytes > 0) std::memcpy(out, stored.data(), bytes);
      return true;
    case format::Codec::kLz4:
    case format::Codec::kZstd:
      return unpack(codec, stored, bytes, out);
    case format::Codec::kConstant:
    case format::Codec::kAbsent:
    case format::Codec::kInSource:
      break;
  }
  return false;
}

}  // namespace isobrick
