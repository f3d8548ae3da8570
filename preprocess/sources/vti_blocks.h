// Blocks of a VTK file that are packed by themselves. Private to preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "isobrick/preprocess/sources/byte_stream.h"

namespace isobrick {

// Unpacks a block, all of it, into exactly `out_bytes`; false if it has another size or is damaged.
using UnpackVtiBlock = bool (*)(const std::byte* in, std::size_t in_bytes, std::byte* out,
                                std::size_t out_bytes);
// Of a compressor by its name in the file, "vtkLZ4DataCompressor" or "vtkLZMADataCompressor"; null
// for others.
UnpackVtiBlock vtiUnpackerNamed(const std::string& compressor);

struct VtiBlockLayout {
  std::uint64_t block_bytes = 0;  // of each, unpacked, but for the last one
  std::uint64_t total_bytes = 0;
  std::size_t word_bytes = 8;  // of a number in the list of sizes
  bool big_endian = false;
};

// Unpacks one block after the other. `sizes` has the packed size of each, `packed` the blocks.
// Holds a block, packed and unpacked. Throws Error, naming `path`, if a block is damaged, cut
// short, or larger than 1 GiB.
std::unique_ptr<ByteStream> makeVtiBlocksStream(const std::string& path,
                                                std::unique_ptr<ByteStream> sizes,
                                                std::unique_ptr<ByteStream> packed,
                                                const VtiBlockLayout& layout,
                                                UnpackVtiBlock unpack);

}  // namespace isobrick
