#include "isobrick/preprocess/scratch_volume.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>

#include "isobrick/preprocess/path_error.h"
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
    throw std::logic_error(concat("a buffer of ", bytes_, " bytes is asked for ", bytes));
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

ScratchSource::ScratchSource(const VolumeSource& source, std::int64_t first, std::int64_t end,
                             const std::string& folder)
    : info_(source.info()),
      files_(source.files()),
      identity_(source.identity()),
      voxels_(IndexBox{{0, 0, first}, {info_.voxels.x, info_.voxels.y, end - first}},
              voxelBytes(info_.voxel_type), ScratchVolume::Place::kFile, folder) {}

void ScratchSource::writeRows(std::int64_t first, std::int64_t count, const std::byte* rows) {
  const std::int64_t y = first % info_.voxels.y, z = first / info_.voxels.y;
  const std::int64_t slices = std::max(std::int64_t{1}, count / info_.voxels.y);
  voxels_.write({{0, y, z}, {info_.voxels.x, count / slices, slices}}, rows);
}

std::unique_ptr<ScratchSource> readIntoScratch(VolumeSource& source, std::int64_t first,
                                               std::int64_t end, const std::string& folder,
                                               const CancelFlag* cancel,
                                               const std::function<void(double)>& progress) {
  auto scratch = std::make_unique<ScratchSource>(source, first, end, folder);
  const VolumeInfo& info = source.info();
  const std::int64_t most_rows = SliceSpool::rowsPerRead(info);
  LargeBuffer rows(static_cast<std::size_t>(most_rows * info.voxels.x) *
                   voxelBytes(info.voxel_type));
  for (std::int64_t z = first; z < end; ++z) {
    if (progress) progress(static_cast<double>(z - first) / static_cast<double>(end - first));
    for (std::int64_t y = 0; y < info.voxels.y; y += most_rows) {
      if (cancel != nullptr) cancel->check();
      const std::int64_t count = std::min(most_rows, info.voxels.y - y);
      source.readRows(z * info.voxels.y + y, count, rows.data());
      scratch->writeRows(z * info.voxels.y + y, count, rows.data());
    }
  }
  scratch->finish(source);
  return scratch;
}

namespace {

// Enough to amortise a call, little beside everything else.
constexpr std::int64_t kBytesPerRead = std::int64_t{1} << 20;

}  // namespace

std::int64_t SliceSpool::rowsPerRead(const VolumeInfo& info) {
  const auto row_bytes = info.voxels.x * static_cast<std::int64_t>(voxelBytes(info.voxel_type));
  return std::clamp<std::int64_t>(kBytesPerRead / row_bytes, 1, info.voxels.y);
}

SliceSpool::SliceSpool(VolumeSource& source, std::int64_t first, std::int64_t slices,
                       ScratchVolume::Place place, const std::string& folder,
                       const CancelFlag* cancel)
    : source_(source),
      cancel_(cancel),
      dims_(source.info().voxels),
      voxel_bytes_(voxelBytes(source.info().voxel_type)),
      slices_(slices),
      ring_({dims_.x, dims_.y, slices}, voxel_bytes_, place, folder),
      begin_(first),
      end_(first),
      reader_([this] { readAhead(); }) {}

SliceSpool::~SliceSpool() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
    changed_.notify_all();
  }
  reader_.join();
}

void SliceSpool::readAhead() {
  try {
    const std::int64_t most_rows = rowsPerRead(source_.info());
    LargeBuffer rows(static_cast<std::size_t>(most_rows * dims_.x) * voxel_bytes_);
    for (std::int64_t z = end_; z < dims_.z; ++z) {
      for (std::int64_t y = 0; y < dims_.y; y += most_rows) {
        {
          std::unique_lock lock(mutex_);
          changed_.wait(lock, [&] { return stopped_ || z < begin_ + slices_; });
          if (stopped_) return;
        }
        if (cancel_ != nullptr) cancel_->check();
        const std::int64_t count = std::min(most_rows, dims_.y - y);
        source_.readRows(z * dims_.y + y, count, rows.data());
        ring_.write({{0, y, z % slices_}, {dims_.x, count, 1}}, rows.data());
      }
      const std::lock_guard lock(mutex_);
      end_ = z + 1;
      changed_.notify_all();
    }
  } catch (...) {
    const std::lock_guard lock(mutex_);
    failure_ = std::current_exception();
    changed_.notify_all();
  }
}

void SliceSpool::waitForSlices(std::int64_t end) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failure_ || end_ >= end; });
  if (end_ < end) std::rethrow_exception(failure_);
}

void SliceSpool::read(const IndexBox& box, void* out) {
  // The call would wait for them for ever.
  if (box.count.z > slices_) throw std::logic_error("more slices are asked for than are held");
  waitForSlices(box.end().z);
  auto* to = static_cast<std::byte*>(out);
  for (std::int64_t z = box.first.z; z < box.end().z; ++z) {
    const IndexBox slice = {{box.first.x, box.first.y, z % slices_}, {box.count.x, box.count.y, 1}};
    ring_.read(slice, to);
    to += static_cast<std::size_t>(slice.size()) * voxel_bytes_;
  }
}

void SliceSpool::releaseBefore(std::int64_t slice) {
  const std::lock_guard lock(mutex_);
  begin_ = std::max(begin_, slice);
  changed_.notify_all();
}

}  // namespace isobrick
