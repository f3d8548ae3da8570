#include "isobrick/storage/range_reader.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>

#include "isobrick/storage/error.h"

namespace isobrick {

// Without O_NONBLOCK a pipe would be waited for; regular files do not heed it.
FileRanges::FileRanges(const std::string& path)
    : file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
  if (fd() < 0)
    throw Error("cannot open '" + path + "': " + std::strerror(errno) + "; check the path",
                {.path = path});
  struct stat status = {};
  const char* why = nullptr;
  if (fstat(fd(), &status) != 0 || !S_ISREG(status.st_mode))
    why = "it is not a regular file; copy it to one";
  else if (status.st_size == 0)
    why = "it is empty; build it again";
  if (why != nullptr) throw Error("cannot read '" + path + "': " + why, {.path = path});
  size_ = static_cast<std::uint64_t>(status.st_size);
}

void FileRanges::read(const ByteRange& range, std::byte* out) {
  if (readBytesAt(fd(), range.offset, out, range.bytes).bytes != range.bytes) throw ReadFailure();
}

void FileRanges::announce(std::span<const ByteRange> ranges) {
  for (const ByteRange& range : ranges)
    posix_fadvise(fd(), static_cast<off_t>(range.offset), static_cast<off_t>(range.bytes),
                  POSIX_FADV_WILLNEED);
}

bool FileRanges::isCached(const ByteRange& range) const {
  const auto has = [&](std::uint64_t offset) {
    char byte = 0;
    const iovec one = {&byte, 1};
    return preadv2(fd(), &one, 1, static_cast<off_t>(offset), RWF_NOWAIT) == 1;
  };
  return has(range.offset) && has(range.offset + range.bytes - 1);
}

}  // namespace isobrick
