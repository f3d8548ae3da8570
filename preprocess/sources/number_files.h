// The files that hold the numbers of an array behind a text header (NRRD, MetaImage) or a binary
// one: bytes, packed bytes or text, in one file or in equal shares in several. Private to
// preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/stored_voxels.h"

namespace isobrick {

struct NumberFiles {
  enum class Form { kBytes, kGzip, kBzip2, kText, kHex, kNibbles };

  std::string header_path;
  std::vector<std::string> paths;  // in the order of their numbers; at least one
  Form form = Form::kBytes;        // kGzip: gzip or zlib; kNibbles: 4 bits a number
  std::uint64_t row_numbers = 0;   // of kNibbles: each row begins with a new byte
  std::uint64_t first_byte = 0;    // behind a header in the same file, or one of their own
  // In front of the numbers of each file: lines, then bytes. Bytes are skipped in the content if it
  // is packed. kAllBefore: all that are in front of as many bytes as the numbers take.
  std::uint64_t skipped_lines = 0;
  std::int64_t skipped_bytes = 0;
  static constexpr std::int64_t kAllBefore = -1;

  // The header, if it is a file of its own, and the others.
  std::vector<std::string> all() const;
  // Where the numbers begin in the only file, if they are bytes in one file. Throws Error if it
  // has not `bytes` of them.
  std::optional<std::uint64_t> offsetOfBytes(std::uint64_t bytes) const;
};

// All numbers, as `bytes` of the type `type`: of text in little-endian order, otherwise as they are
// stored. Throws Error that names the file and the byte if one ends early or is damaged.
std::unique_ptr<ByteStream> makeNumberStream(const NumberFiles& files, StoredType type,
                                             std::uint64_t bytes);

}  // namespace isobrick
