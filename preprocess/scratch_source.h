// Slices of a source that is read in order, in a temporary file: a source of boxes.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// The whole volume by its info(), of which only the slices that were written may be read.
class ScratchSource final : public VolumeSource {
 public:
  // For slices [first, end) of `source`. The file is as long as they are, lies in `folder` and is
  // removed with this object. Throws ResumableError if it cannot be made.
  ScratchSource(const VolumeSource& source, std::int64_t first, std::int64_t end,
                const std::string& folder);

  // Rows of one slice, or whole slices, numbered as by readRows(). Throws ResumableError if there
  // is no room for them.
  void writeRows(std::int64_t first, std::int64_t count, const std::byte* rows);
  // After the last row: takes over the notes of `source`.
  void finish(const VolumeSource& source) { notes_of_reading_ = source.notesOfReading(); }

  const VolumeInfo& info() const override { return info_; }
  bool readsBoxes() const override { return true; }
  std::vector<std::string> files() const override { return files_; }
  std::string identity() const override { return identity_; }
  std::vector<std::string> notesOfReading() const override { return notes_of_reading_; }
  void readBox(const IndexBox& box, void* out) const override { voxels_.read(box, out); }

  std::int64_t firstSlice() const { return voxels_.box().first.z; }
  std::int64_t endSlice() const { return voxels_.box().end().z; }

 private:
  VolumeInfo info_;
  std::vector<std::string> files_;
  std::string identity_;
  std::vector<std::string> notes_of_reading_;
  ScratchVolume voxels_;
};

// Reads slices [first, end) of `source`, of which no later one was read, once. `cancel` and
// `progress` (a share, 0 .. 1) may be empty. Throws ResumableError if there is no room in `folder`,
// Cancelled, and what the source throws.
std::unique_ptr<ScratchSource> readIntoScratch(VolumeSource& source, std::int64_t first,
                                               std::int64_t end, const std::string& folder,
                                               const CancelFlag* cancel,
                                               const std::function<void(double)>& progress);

}  // namespace isobrick
