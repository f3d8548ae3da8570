#include "isobrick/preprocess/slice_spool.h"

#include <algorithm>
#include <stdexcept>

namespace isobrick {
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
