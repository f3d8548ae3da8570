// A file that is only read, by position. Private to preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace isobrick {

// Owns the descriptor. Errors name the path, the byte and the reason.
class InputFile {
 public:
  // `named_by` is the header that names the file, or empty. Throws Error for what cannot be opened
  // and for what is no regular file.
  explicit InputFile(const std::string& path, const std::string& named_by = "");
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  const std::string& path() const { return path_; }
  std::uint64_t size() const { return size_; }  // when it was opened

  // Reads `bytes` at `offset`, fewer only where the file ends; returns how many. By any number of
  // threads at once. Throws ResumableError where the disk fails.
  std::size_t readAt(std::uint64_t offset, void* out, std::size_t bytes) const;

 private:
  std::string path_;
  int fd_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace isobrick
