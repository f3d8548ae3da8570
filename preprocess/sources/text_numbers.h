// Numbers that a file has as text. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>

#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/stored_voxels.h"

namespace isobrick {

// The bytes, in the order of the machine, of `count` numbers that stand in the file from `offset`
// on with blanks between them; fewer if a '<' or the end of the file comes before. Holds 160 KiB.
// Throws Error, naming the byte, at a word that is no number of the type.
std::unique_ptr<ByteStream> makeTextNumbers(std::shared_ptr<const InputFile> file,
                                            std::uint64_t offset, StoredType type,
                                            std::uint64_t count);

}  // namespace isobrick
