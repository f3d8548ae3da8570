// A file that is only read, by position, and numbers of either byte order in its bytes.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <string>

#include "isobrick/storage/file_io.h"

namespace isobrick {

// False only if nothing has that name, neither a file nor a link, and no folder on the way is a
// link to nowhere. Throws Error for a name that cannot be reached, such as the links of git-annex
// and DataLad to files that were not fetched.
bool inputIsThere(const std::string& path);

// Owns the descriptor. Errors name the path, the byte and the reason.
class InputFile {
 public:
  // `named_by` is the header that names the file, or empty. Throws Error if the path cannot be
  // opened or is no regular file.
  explicit InputFile(const std::string& path, const std::string& named_by = "");

  const std::string& path() const { return path_; }
  // When it was opened: its bytes, and the time of its last change.
  std::uint64_t size() const { return size_; }
  const std::timespec& changedAt() const { return changed_at_; }

  // Reads `bytes` at `offset`, fewer only if the file ends; returns how many. By any number of
  // threads at once. Throws ResumableError if the disk fails.
  std::size_t readAt(std::uint64_t offset, void* out, std::size_t bytes) const;

 private:
  std::string path_;
  OpenDescriptor file_;
  std::uint64_t size_ = 0;
  std::timespec changed_at_ = {};
};

// The number of type T that is stored at `from`.
template <typename T>
T loadNumber(const void* from, bool big_endian) {
  std::array<std::byte, sizeof(T)> bytes;
  std::memcpy(bytes.data(), from, sizeof(T));
  if (big_endian != (std::endian::native == std::endian::big)) std::ranges::reverse(bytes);
  return std::bit_cast<T>(bytes);
}

// An unsigned number of 1 to 8 bytes.
inline std::uint64_t loadUnsigned(const void* from, std::size_t bytes, bool big_endian) {
  std::array<std::byte, 8> whole{};
  std::memcpy(whole.data() + (big_endian ? 8 - bytes : 0), from, bytes);
  return loadNumber<std::uint64_t>(whole.data(), big_endian);
}

}  // namespace isobrick
