// Bytes of a pyramid's file changed at their offsets, and its header and tables sealed again. These
// are the offsets of docs/FORMAT.md, not the structs of the library. To change parts:
// sealed_pyramid.h.
#pragma once

#include <cstdint>
#include <string>

#include "tests/support/sealed_pyramid.h"

namespace isobrick::test {

// Section 2.
constexpr std::uint64_t kFileBytesAt = 16, kLevelTableAt = 216, kBrickTableAt = 232,
                        kBrickCountAt = 240, kHeaderChecksumAt = 504;
constexpr std::uint64_t kLevelRowBytes = 56, kBrickRowBytes = 96;

void putU32(Bytes& bytes, std::uint64_t at, std::uint32_t value);
void putU64(Bytes& bytes, std::uint64_t at, std::uint64_t value);
std::uint64_t getU64(const Bytes& bytes, std::uint64_t at);

// Anybody who edits header or tables can do this: the hashes are no secret. sealTables() seals the
// header too, and leaves the checksums of parts and provenance.
void sealHeader(Bytes& bytes);
void sealTables(Bytes& bytes);

// Replaces a file in place: ext4 flushes one that was truncated and written anew, which costs a
// millisecond.
void writeBytes(const std::string& path, const Bytes& bytes);

}  // namespace isobrick::test
