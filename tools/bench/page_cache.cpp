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

namespace isobrick {
namespace {

class OpenFile {
 public:
  explicit OpenFile(const std::string& path)
      : descriptor_(open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    if (descriptor_ < 0)
      throw Error(fmt::format("cannot open '{}': {}", path, std::strerror(errno)));
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  ~OpenFile() { close(descriptor_); }
  int descriptor() const { return descriptor_; }

 private:
  int descriptor_;
};

}  // namespace

void dropFromPageCache(const std::string& path) {
  const OpenFile file(path);
  fdatasync(file.descriptor());  // a page that waits for the disk is not dropped
  posix_fadvise(file.descriptor(), 0, 0, POSIX_FADV_DONTNEED);
}

double cachedShare(const std::string& path) {
  const OpenFile file(path);
  struct stat status {};
  fstat(file.descriptor(), &status);
  const auto bytes = static_cast<std::size_t>(status.st_size);
  if (bytes == 0) return 0;
  void* const map = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file.descriptor(), 0);
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
