#include "tools/bench/page_cache.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {
namespace {

OpenDescriptor openedForReading(const std::string& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) throw Error(fmt::format("cannot open '{}': {}", path, std::strerror(errno)));
  return OpenDescriptor(fd);
}

}  // namespace

void dropFromPageCache(const std::string& path) {
  const OpenDescriptor file = openedForReading(path);
  fdatasync(file.get());  // a page that waits for the disk is not dropped
  posix_fadvise(file.get(), 0, 0, POSIX_FADV_DONTNEED);
}

double cachedShare(const std::string& path) {
  const OpenDescriptor file = openedForReading(path);
  struct stat status {};
  fstat(file.get(), &status);
  const auto bytes = static_cast<std::size_t>(status.st_size);
  if (bytes == 0) return 0;
  void* const map = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file.get(), 0);
  if (map == MAP_FAILED)
    throw Error(fmt::format("cannot map '{}': {}", path, std::strerror(errno)));
  const auto page_bytes = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  std::vector<unsigned char> pages((bytes + page_bytes - 1) / page_bytes);
  const int failure = mincore(map, bytes, pages.data()) == 0 ? 0 : errno;
  munmap(map, bytes);
  if (failure != 0)
    throw Error(fmt::format("cannot ask for the pages of '{}': {}", path, std::strerror(failure)));
  const auto cached = std::count_if(pages.begin(), pages.end(), [](auto p) { return p & 1u; });
  return static_cast<double>(cached) / static_cast<double>(pages.size());
}

}  // namespace isobrick
