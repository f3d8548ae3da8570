// Reads boxes from a source that can only be read in order.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <string>
#include <thread>

#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

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
