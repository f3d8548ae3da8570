// Inflates bytes as they are read. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "isobrick/preprocess/sources/byte_stream.h"

namespace isobrick {

// The content of `packed`, which is in gzip or zlib form. Gzip members that follow each other are
// one content; bytes after the last one are ignored. Holds 256 KiB of packed bytes and zlib's
// window, and writes straight to the caller's memory.
//
// read() throws Error, naming `path` and the byte of content, if the data end before their own end
// mark or are damaged. finish() checks the checksum if it is near.
std::unique_ptr<ByteStream> makeInflateStream(const std::string& path,
                                              std::unique_ptr<ByteStream> packed);

// The same of one bzip2 stream. Holds at most 4 MiB.
std::unique_ptr<ByteStream> makeBunzipStream(const std::string& path,
                                             std::unique_ptr<ByteStream> packed);

// The blocks of a VTK file: zlib streams one behind the other that inflate to `block_bytes` each,
// the last one to the rest of `total_bytes`. A block of another size is damage.
std::unique_ptr<ByteStream> makeInflateBlocksStream(const std::string& path,
                                                    std::unique_ptr<ByteStream> packed,
                                                    std::uint64_t block_bytes,
                                                    std::uint64_t total_bytes);

}  // namespace isobrick
