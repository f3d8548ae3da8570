// Counts and sizes as text to read.
#pragma once

#include <cstdint>
#include <string>

namespace isobrick {

// "512 bytes", "1.50 GiB"; the bytes themselves are for --json.
std::string byteSizeText(std::uint64_t bytes);
// "1,234,567"
std::string countText(std::uint64_t count);

// The greatest memory that the process held at any moment so far, in bytes.
std::uint64_t peakResidentBytes();

}  // namespace isobrick
