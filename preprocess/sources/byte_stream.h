// Bytes that come one after the other: of a file, decoded from base64, unpacked. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/sources/stored_voxels.h"

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

// Of pieces that are made one after the other.
class PieceStream : public ByteStream {
 public:
  std::size_t read(void* out, std::size_t bytes) final;

 protected:
  std::vector<std::byte> piece_;

 private:
  // Makes the next one; false if there is none, or it is empty.
  virtual bool refill() = 0;

  std::size_t next_ = 0;  // in piece_
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

// The bytes, in the order of the machine, of `count` numbers that stand in the file from `offset`
// on with blanks or commas between them; fewer if a '<' or the end of the file comes before. Holds
// 160 KiB. Throws Error, naming the byte, at a word that is no number of the type.
std::unique_ptr<ByteStream> makeTextNumbers(std::shared_ptr<const InputFile> file,
                                            std::uint64_t offset, StoredType type,
                                            std::uint64_t count);

}  // namespace isobrick
