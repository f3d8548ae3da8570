#include "tests/support/file_edits.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstring>
#include <stdexcept>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace isobrick::test {

void putU32(Bytes& bytes, std::uint64_t at, std::uint32_t value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}

void putU64(Bytes& bytes, std::uint64_t at, std::uint64_t value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}

std::uint64_t getU64(const Bytes& bytes, std::uint64_t at) {
  std::uint64_t value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

void sealHeader(Bytes& bytes) {
  putU64(bytes, kHeaderChecksumAt, XXH3_64bits(bytes.data(), kHeaderChecksumAt));
}

void sealTables(Bytes& bytes) {
  std::uint32_t levels;
  std::memcpy(&levels, bytes.data() + 32, sizeof levels);
  putU64(bytes, kLevelTableAt + 8,
         XXH3_64bits(bytes.data() + getU64(bytes, kLevelTableAt), levels * kLevelRowBytes));
  const std::uint64_t rows = getU64(bytes, kBrickCountAt);
  for (std::uint64_t row = 0; row < rows; ++row) {
    const std::uint64_t at = getU64(bytes, kBrickTableAt) + row * kBrickRowBytes;
    putU64(bytes, at + kBrickRowBytes - 8,
           XXH3_64bits_withSeed(bytes.data() + at, kBrickRowBytes - 8, row));
  }
  sealHeader(bytes);
}

void writeBytes(const std::string& path, const Bytes& bytes) {
  const int fd = open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  const bool written =
      fd >= 0 && pwrite(fd, bytes.data(), bytes.size(), 0) == static_cast<ssize_t>(bytes.size()) &&
      ftruncate(fd, static_cast<off_t>(bytes.size())) == 0;
  if (fd >= 0) close(fd);
  if (!written) throw std::runtime_error("cannot write " + path);
}

}  // namespace isobrick::test
