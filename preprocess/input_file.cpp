#include "isobrick/preprocess/input_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {

InputFile::InputFile(const std::string& path, const std::string& named_by) : path_(path) {
  // Without O_NONBLOCK a pipe would be waited for; regular files do not heed it.
  fd_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  const std::string name =
      "'" + path + "'" + (named_by.empty() ? "" : ", which '" + named_by + "' names");
  if (fd_ < 0)
    throw Error("cannot open " + name + ": " + std::strerror(errno) + "; check the path",
                {.path = path});
  struct stat status = {};
  if (fstat(fd_, &status) != 0 || !S_ISREG(status.st_mode)) {
    close(fd_);
    throw Error("cannot read " + name + ": it is not a regular file; copy it to one",
                {.path = path});
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
  changed_at_ = status.st_mtim;
  posix_fadvise(fd_, 0, 0, POSIX_FADV_SEQUENTIAL);
}

InputFile::~InputFile() { close(fd_); }

std::size_t InputFile::readAt(std::uint64_t offset, void* out, std::size_t bytes) const {
  const IoResult result = readBytesAt(fd_, offset, out, bytes);
  if (result.error != 0)
    throw ResumableError("cannot read '" + path_ + "' " + ioFailureText(offset, result) +
                             "; check the disk, then run again",
                         {.path = path_, .offset = offset + result.bytes});
  return result.bytes;
}

}  // namespace isobrick
