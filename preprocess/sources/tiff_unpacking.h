// Packed pictures of a TIFF file, by libtiff. Private to preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/tiff_source.h"

namespace isobrick {

// The numbers of the page at byte `page_at`: rows from the upper left corner, the numbers of a
// pixel side by side, in this machine's byte order; floating ones of 16 bits became ones of 32.
// Throws Error that names the file and says what is wrong with it. `buffer` is used if it has room.
void unpackTiffPage(const std::string& path, std::uint64_t page_at, const TiffSlices::Form& form,
                    std::vector<std::byte>& buffer);

}  // namespace isobrick
