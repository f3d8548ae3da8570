#include "isobrick/extract/sinks/side_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {

SideFile::SideFile(const std::string& mesh_path, const std::string& what)
    : path_(mesh_path + "." + what + ".XXXXXX") {
  fd_ = ::mkostemp(path_.data(), O_CLOEXEC);  // a unique name
  if (fd_ < 0) fail(std::strerror(errno));
  ::unlink(path_.c_str());
}

SideFile::~SideFile() { ::close(fd_); }

void SideFile::pwrite(const void* data, std::size_t bytes, std::uint64_t offset) {
  const IoResult result = writeBytesAt(fd_, offset, data, bytes);
  if (result.error != 0) fail(ioFailureText(offset, result));
}

void SideFile::read(void* out, std::size_t bytes, std::uint64_t offset) const {
  const IoResult result = readBytesAt(fd_, offset, out, bytes);
  if (result.error != 0 || result.bytes != bytes) fail(ioFailureText(offset, result));
}

void SideFile::appendTo(AtomicFile& file, std::uint64_t bytes, const CancelFlag* cancel) const {
  constexpr std::uint64_t kStepBytes = std::uint64_t{1} << 20;
  std::vector<std::byte> buffer(static_cast<std::size_t>(std::min(bytes, kStepBytes)));
  for (std::uint64_t at = 0; at < bytes;) {
    if (cancel != nullptr) cancel->check();
    const auto step = static_cast<std::size_t>(std::min(bytes - at, kStepBytes));
    read(buffer.data(), step, at);
    file.write(buffer.data(), step);
    at += step;
  }
}

void SideFile::fail(const std::string& why) const {
  throw Error("cannot write '" + path_ + "': " + why + "; free some space or choose another folder",
              {.path = path_});
}

}  // namespace isobrick
