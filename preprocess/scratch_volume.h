// Room for intermediate results of a build: blocks in memory or in a temporary file, and the slices
// of a source that is read in order.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// Memory for large buffers: requests huge pages, which come ten times as fast as small ones. The
// bytes are not set to anything. Throws std::bad_alloc.
class LargeBuffer {
 public:
  LargeBuffer() = default;
  explicit LargeBuffer(std::size_t bytes);
  std::byte* data() const { return data_.get(); }
  std::size_t size() const { return bytes_; }
  // data(), for so many bytes. Throws std::logic_error if the buffer has fewer: nothing is ever
  // written beyond it, however its size was computed.
  std::byte* dataFor(std::size_t bytes) const;

 private:
  struct Free {
    void operator()(std::byte* data) const;
  };
  std::unique_ptr<std::byte, Free> data_;
  std::size_t bytes_ = 0;
};

// A dense box of elements, x fastest, in memory or in a file that has no name and vanishes with
// the process. Boxes that do not overlap may be read and written by several threads at once.
class ScratchVolume {
 public:
  enum class Place { kMemory, kFile };
  // The file is made in `folder`. Throws ResumableError if that fails.
  ScratchVolume(const IndexBox& box, std::size_t element_bytes, Place place,
                const std::string& folder);
  ScratchVolume(const Index3& dims, std::size_t element_bytes, Place place,
                const std::string& folder)
      : ScratchVolume(IndexBox{Index3(0), dims}, element_bytes, place, folder) {}
  ~ScratchVolume();
  ScratchVolume(const ScratchVolume&) = delete;
  ScratchVolume& operator=(const ScratchVolume&) = delete;

  // The indices of its elements.
  const IndexBox& box() const { return box_; }
  std::size_t elementBytes() const { return element_bytes_; }
  // Copies the elements of `box` from or to a dense block. A write to a full disk throws
  // ResumableError.
  void write(const IndexBox& box, const void* elements);
  void read(const IndexBox& box, void* elements) const;

 private:
  // Calls `f(bytes from the start, bytes from the block's start, byte count)` for every run of
  // elements that lie together.
  template <typename F>
  void forRuns(const IndexBox& box, F&& f) const;

  IndexBox box_;
  std::size_t element_bytes_;
  std::string folder_;
  LargeBuffer memory_;
  int fd_ = -1;
};

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

// A thread of its own reads the source, some slices ahead of their use, into a ring of slices that
// lies in memory or in a temporary file. The slices below releaseBefore() give their place to later
// ones. One thread may use the members; nothing else may use the source.
class SliceSpool {
 public:
  // The ring holds `slices` slices, at least as many as any box spans that is read (plus those
  // between it and the last releaseBefore()). Reading begins with slice `first`. `cancel`, which
  // may be null and outlives the spool, ends reading after the rows that are being read: read()
  // throws Cancelled then.
  SliceSpool(VolumeSource& source, std::int64_t first, std::int64_t slices,
             ScratchVolume::Place place, const std::string& folder, const CancelFlag* cancel);
  // Stops the thread after the rows that it is reading.
  ~SliceSpool();
  SliceSpool(const SliceSpool&) = delete;
  SliceSpool& operator=(const SliceSpool&) = delete;

  // Copies `box`, x fastest, as soon as its slices were read. Throws what the source threw.
  void read(const IndexBox& box, void* out);
  void releaseBefore(std::int64_t slice);

  // Rows that the thread reads at a time.
  static std::int64_t rowsPerRead(const VolumeInfo& info);

 private:
  void readAhead();
  void waitForSlices(std::int64_t end);

  VolumeSource& source_;
  const CancelFlag* const cancel_;
  const Index3 dims_;
  const std::size_t voxel_bytes_;
  const std::int64_t slices_;
  ScratchVolume ring_;
  std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::int64_t begin_;  // first slice that is still needed
  std::int64_t end_;    // slices below it are in the ring
  std::exception_ptr failure_;
  bool stopped_ = false;
  std::thread reader_;  // last: it uses all the others
};

}  // namespace isobrick
