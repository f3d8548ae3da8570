// Inflating as the bytes are asked for. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "isobrick/preprocess/sources/byte_stream.h"

namespace isobrick {

// What `packed` holds in gzip or zlib form, whichever it is. Gzip members that follow each other
// are one content; what follows the last one is ignored. Holds 256 KiB of packed bytes and zlib's
// window, and writes straight to where the caller wants it.
//
// read() throws Error, naming `path` and the byte of content, where the data end before their own
// end mark or are damaged. finish() looks at the checksum where it is near.
std::unique_ptr<ByteStream> makeInflateStream(const std::string& path,
                                              std::unique_ptr<ByteStream> packed);

// The blocks of a VTK file: zlib streams one behind the other that inflate to `block_bytes` each,
// the last one to what is missing to `total_bytes`. A block of another size is damage.
std::unique_ptr<ByteStream> makeInflateBlocksStream(const std::string& path,
                                                    std::unique_ptr<ByteStream> packed,
                                                    std::uint64_t block_bytes,
                                                    std::uint64_t total_bytes);

}  // namespace isobrick
