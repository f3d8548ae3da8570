// Bytes that come one after the other: of a file, decoded from base64, inflated. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "isobrick/preprocess/input_file.h"

namespace isobrick {

// One thread at a time. Errors name the file: Error for damage, ResumableError if the disk fails.
class ByteStream {
 public:
  virtual ~ByteStream() = default;
  // Writes the next `bytes` to `out`, fewer only if the content ends; returns how many.
  virtual std::size_t read(void* out, std::size_t bytes) = 0;
  // Call it after the last read: throws Error if the content fails a checksum that comes now. Reads
  // no further than that takes, and not much.
  virtual void finish() {}
  // The most bytes that the stream holds.
  virtual std::uint64_t bufferBytes() const { return 0; }
};

// Reads and forgets `bytes`; returns how many there were.
std::uint64_t skipBytes(ByteStream& stream, std::uint64_t bytes);

// The bytes of the file from `offset` on. Holds nothing.
std::unique_ptr<ByteStream> makeFileStream(std::shared_ptr<const InputFile> file,
                                           std::uint64_t offset);

// The bytes of the base64 text from `offset` on, up to the next '<' or the end of the file.
// White space is skipped; after padding another text may follow at once, as VTK writes it. Throws
// Error at any other character.
std::unique_ptr<ByteStream> makeBase64Stream(std::shared_ptr<const InputFile> file,
                                             std::uint64_t offset);

}  // namespace isobrick
