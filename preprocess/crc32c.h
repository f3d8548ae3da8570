// The checksum of Zarr's shards.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace isobrick {

// CRC-32C (Castagnoli), as Zarr's index of a shard has it.
std::uint32_t crc32c(std::span<const std::byte> bytes);

}  // namespace isobrick
