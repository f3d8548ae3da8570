// Blocks of a file that are unpacked as a whole, to a size that is known before. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace isobrick {

// kZlib: or gzip; kDeflate: with neither head; kSizedLz4: LZ4 behind the number of its bytes.
enum class BlockCodec { kNone, kBlosc, kZlib, kDeflate, kZstd, kLz4, kSizedLz4, kBz2, kLzma };

// Unpacks `packed`, which must become exactly out.size() bytes. Returns its fault, fit for "...:
// FAULT", or nothing. Input is hostile: nothing is read or written beyond the spans.
std::string unpackBlock(BlockCodec codec, std::span<const std::byte> packed,
                        std::span<std::byte> out);

// The most that so many packed bytes can become: zlib packs 1032 bytes into one, LZ4 255, and all
// others are taken for 2^14.
std::uint64_t mostUnpackedBytes(BlockCodec codec, std::uint64_t packed_bytes);

// The most that `bytes` unpacked bytes can take packed: no more than that is ever read.
inline std::uint64_t mostPackedBytes(std::uint64_t bytes) { return bytes + bytes / 16 + (1 << 16); }

}  // namespace isobrick
