#include "isobrick/storage/checksum.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace isobrick {

std::uint64_t checksum64(const void* data, std::size_t bytes) { return XXH3_64bits(data, bytes); }

}  // namespace isobrick
