#include "isobrick/preprocess/scratch_volume.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {
namespace {

constexpr std::size_t kHugePageBytes = std::size_t{2} << 20;

// A file without a name; file systems that have none get one whose name is removed at once.
int openTemporary(const std::string& folder) {
  int fd = open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (fd >= 0) return fd;
  std::string name = folder + "/.isobrick-scratch-XXXXXX";
  fd = mkostemp(name.data(), O_CLOEXEC);
  if (fd >= 0) unlink(name.c_str());
  return fd;
}

}  // namespace

LargeBuffer::LargeBuffer(std::size_t bytes) : bytes_(bytes) {
  if (bytes < kHugePageBytes) {
    data_.reset(static_cast<std::byte*>(std::malloc(bytes > 0 ? bytes : 1)));
  } else {
    const std::size_t whole = (bytes + kHugePageBytes - 1) / kHugePageBytes * kHugePageBytes;
    data_.reset(static_cast<std::byte*>(std::aligned_alloc(kHugePageBytes, whole)));
    if (data_) madvise(data_.get(), whole, MADV_HUGEPAGE);
  }
  if (!data_) throw std::bad_alloc();
}

std::byte* LargeBuffer::dataFor(std::size_t bytes) const {
  if (bytes > bytes_)
    throw std::logic_error("a buffer of " + std::to_string(bytes_) + " bytes is asked for " +
                           std::to_string(bytes));
  return data_.get();
}

void LargeBuffer::Free::operator()(std::byte* data) const { std::free(data); }

ScratchVolume::ScratchVolume(const IndexBox& box, std::size_t element_bytes, Place place,
                             const std::string& folder)
    : box_(box), element_bytes_(element_bytes), folder_(folder) {
  if (place == Place::kMemory) {
    memory_ = LargeBuffer(static_cast<std::size_t>(box.size()) * element_bytes);
    return;
  }
  fd_ = openTemporary(folder);
  if (fd_ < 0)
    throw ResumableError("cannot make a temporary file in '" + folder + "': " +
                             std::strerror(errno) + "; choose a folder that you may write to",
                         {.path = folder});
}

ScratchVolume::~ScratchVolume() {
  if (fd_ >= 0) close(fd_);
}

template <typename F>
void ScratchVolume::forRuns(const IndexBox& box, F&& f) const {
  // Whole rows of one slice lie together, and so do whole slices.
  std::int64_t run = box.count.x, runs_y = box.count.y, runs_z = box.count.z;
  if (box.count.x == box_.count.x) {
    run *= runs_y;
    runs_y = 1;
    if (box.count.y == box_.count.y) {
      run *= runs_z;
      runs_z = 1;
    }
  }
  const std::size_t bytes = static_cast<std::size_t>(run) * element_bytes_;
  std::size_t at = 0;
  for (std::int64_t z = 0; z < runs_z; ++z)
    for (std::int64_t y = 0; y < runs_y; ++y, at += bytes)
      f(static_cast<std::size_t>(
            linearIndex(box.first - box_.first + Index3(0, y, z), box_.count)) *
            element_bytes_,
        at, bytes);
}

void ScratchVolume::write(const IndexBox& box, const void* elements) {
  forRuns(box, [&](std::size_t offset, std::size_t at, std::size_t bytes) {
    const std::byte* from = static_cast<const std::byte*>(elements) + at;
    if (fd_ < 0) {
      std::memcpy(memory_.data() + offset, from, bytes);
      return;
    }
    const IoResult result = writeBytesAt(fd_, offset, from, bytes);
    if (result.error != 0)
      throw ResumableError("cannot write a temporary file in '" + folder_ +
                               "': " + std::strerror(result.error) +
                               "; free some space, choose another folder, or allow more memory",
                           {.path = folder_}, {Remedy::kOtherFolder, Remedy::kAllowMoreMemory});
  });
}

void ScratchVolume::read(const IndexBox& box, void* elements) const {
  forRuns(box, [&](std::size_t offset, std::size_t at, std::size_t bytes) {
    std::byte* to = static_cast<std::byte*>(elements) + at;
    if (fd_ < 0) {
      std::memcpy(to, memory_.data() + offset, bytes);
      return;
    }
    const IoResult result = readBytesAt(fd_, offset, to, bytes);
    if (result.bytes < bytes)
      throw ResumableError("cannot read a temporary file in '" + folder_ + "' " +
                               ioFailureText(offset, result) + "; check the disk",
                           {.path = folder_});
  });
}

}  // namespace isobrick
