// The checksum of the file format.
#pragma once

#include <cstddef>
#include <cstdint>

namespace isobrick {

// XXH3-64 with seed 0.
std::uint64_t checksum64(const void* data, std::size_t bytes);

}  // namespace isobrick
