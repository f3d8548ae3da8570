// What Zarr chunks are packed with. Private to preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace isobrick {

enum class ZarrCodec { kNone, kBlosc, kZlib, kGzip, kZstd };

// Unpacks `packed`, which must become exactly out.size() bytes. Returns what is wrong with it, fit
// for "...: WHAT", or nothing. Input is hostile: nothing is read or written beyond the spans.
std::string unpackZarr(ZarrCodec codec, std::span<const std::byte> packed,
                       std::span<std::byte> out);

// The most that `bytes` unpacked bytes can take packed: more than that is read by nobody.
std::uint64_t mostPackedBytes(std::uint64_t bytes);

// CRC-32C (Castagnoli), as Zarr's index of a shard has it.
std::uint32_t crc32c(std::span<const std::byte> bytes);

}  // namespace isobrick
