#include "preprocess/input_identity.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "storage/checksum.h"
#include "storage/error.h"

namespace isobrick {
namespace {

// Headers are at the beginning, and what was cut off is missing at the end.
constexpr std::uint64_t kEndBytes = std::uint64_t{64} << 10;
constexpr std::uint64_t kBlockBytes = std::uint64_t{4} << 10;
constexpr std::uint64_t kBlocks = 16;

class OpenFile {
 public:
  explicit OpenFile(const std::string& path)
      : path_(path), fd_(open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    if (fd_ < 0) fail();
    if (fstat(fd_, &status_) != 0) {
      close(fd_);
      fail();
    }
  }
  ~OpenFile() { close(fd_); }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;

  const struct stat& status() const { return status_; }

  // Appends what the file has of [offset, offset + bytes) to `text`.
  void appendTo(std::string& text, std::uint64_t offset, std::uint64_t bytes) const {
    const std::size_t begin = text.size();
    text.resize(begin + bytes);
    ssize_t got = 0;
    do {
      got = pread(fd_, text.data() + begin, bytes, static_cast<off_t>(offset));
    } while (got < 0 && errno == EINTR);
    if (got < 0) fail();
    text.resize(begin + static_cast<std::size_t>(got));
  }

 private:
  [[noreturn]] void fail() const {
    throw ResumableError("cannot read '" + path_ + "': " + std::strerror(errno) +
                         "; check the path and the disk");
  }

  std::string path_;
  int fd_ = -1;
  struct stat status_ = {};
};

std::uint64_t contentSample(const OpenFile& file) {
  const auto bytes = static_cast<std::uint64_t>(file.status().st_size);
  std::string sample;
  file.appendTo(sample, 0, std::min(bytes, kEndBytes));
  file.appendTo(sample, bytes - std::min(bytes, kEndBytes), std::min(bytes, kEndBytes));
  for (std::uint64_t block = 1; block < kBlocks; ++block)
    file.appendTo(sample, bytes / kBlocks * block, std::min(bytes, kBlockBytes));
  return checksum64(sample.data(), sample.size());
}

}  // namespace

std::string inputIdentity(const VolumeSource& source) {
  std::uint64_t total = 0;
  std::string facts;
  const auto add = [&](std::uint64_t number) {
    facts.append(reinterpret_cast<const char*>(&number), sizeof number);
  };
  const std::vector<std::string> paths = source.files();
  for (const std::string& path : paths) {
    const OpenFile file(path);
    total += static_cast<std::uint64_t>(file.status().st_size);
    add(static_cast<std::uint64_t>(file.status().st_size));
    add(static_cast<std::uint64_t>(file.status().st_mtim.tv_sec));
    add(static_cast<std::uint64_t>(file.status().st_mtim.tv_nsec));
    add(contentSample(file));
  }
  if (paths.empty()) facts = source.info().source;
  char text[100];
  std::snprintf(text, sizeof text, "%zu files, %llu bytes, %016llx", paths.size(),
                static_cast<unsigned long long>(total),
                static_cast<unsigned long long>(checksum64(facts.data(), facts.size())));
  return text;
}

}  // namespace isobrick
