// A zip archive that is written from its first byte to its last.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/atomic_file.h"

namespace isobrick {

// A part of the bytes of a member, packed by itself: parts one behind the other are one stream.
struct PackedText {
  std::vector<unsigned char> bytes;
  std::uint64_t plain_bytes = 0;
  std::uint32_t checksum = 0;  // CRC-32 of the plain bytes
};
// From any thread.
PackedText packText(std::string_view text);

// Adds members to `file`, which outlives it. Members may have any size: those above 4 GiB, or
// behind that, are zip64. Times are not stored, so that equal members are equal bytes.
class ZipWriter {
 public:
  explicit ZipWriter(AtomicFile& file) : file_(file) {}

  void beginMember(const std::string& name);
  void add(const PackedText& text);
  void endMember();
  // The directory of all members; the archive is whole then.
  void finish();

 private:
  struct Member {
    std::string name;
    std::uint64_t header_at = 0, packed_bytes = 0, plain_bytes = 0;
    std::uint32_t checksum = 0;
  };
  AtomicFile& file_;
  std::vector<Member> members_;
};

}  // namespace isobrick
