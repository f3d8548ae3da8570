// Numbers that a file has as text. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>

#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/stored_voxels.h"

namespace isobrick {

// The bytes, in the order of the machine, of numbers that stand in the file from `offset` on with
// blanks between them, up to the next '<' or the end of the file. Holds 128 KiB. Throws Error,
// naming the byte, at a word that is no number of the type.
std::unique_ptr<ByteStream> makeTextNumbers(std::shared_ptr<const InputFile> file,
                                            std::uint64_t offset, StoredType type);

}  // namespace isobrick
