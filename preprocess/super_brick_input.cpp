#include "isobrick/preprocess/super_brick_input.h"

#include <utility>

#include "isobrick/storage/file_system.h"

namespace isobrick {

SuperBrickInput::SuperBrickInput(std::function<std::unique_ptr<VolumeSource>()> open,
                                 std::string folder)
    : open_(std::move(open)), folder_(std::move(folder)), source_(open_()) {}

const VolumeSource& SuperBrickInput::volume() const {
  return source_ != nullptr ? *source_ : *scratch_;
}

VolumeSource& SuperBrickInput::sourceOf(std::span<const SuperBrickFile> next,
                                        const CancelFlag* cancel,
                                        const std::function<void(double)>& progress) {
  const IndexBox& needs = next.front().reads;
  if (scratch_ != nullptr && scratch_->firstSlice() <= needs.first.z &&
      needs.end().z <= scratch_->endSlice())
    return *scratch_;
  scratch_.reset();
  // What is read in order is read once.
  if (source_ == nullptr || (is_read_ && !source_->readsBoxes())) source_ = open_();
  if (chosen_) source_->chooseVoxelsAs(*chosen_);
  source_->chooseVoxels(cancel, progress);
  chosen_ = source_->info();
  is_read_ = true;
  const bool has_neighbours =
      next.size() > 1 && next[1].voxels.first.z == next.front().voxels.first.z;
  if (source_->readsBoxes() || !has_neighbours || !hasRoomFor(needs.count.z)) return *source_;
  scratch_ = readIntoScratch(*source_, needs.first.z, needs.end().z, folder_, cancel, progress);
  source_.reset();
  return *scratch_;
}

// For the slices, and beside them for the pyramid's files of them and its own temporary files.
bool SuperBrickInput::hasRoomFor(std::int64_t slices) const {
  const VolumeInfo& info = source_->info();
  const auto bytes = static_cast<std::uint64_t>(info.voxels.x * info.voxels.y * slices) *
                     voxelBytes(info.voxel_type);
  return diskSpaceAt(folder_).value_or(DiskSpace{}).free / 3 >= bytes;
}

}  // namespace isobrick
