// A coarse version of a volume while its pyramid is built, for users who wait for it.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// The memory of a build for its previews, beside all else: their samples, and the build of
// one of them.
inline constexpr std::uint64_t kPreviewBytes = std::uint64_t{40} << 20;

// The samples of a preview of the whole volume.
struct PreviewGrid {
  std::int64_t step = 2;  // voxels from one to the next, a power of two
  Index3 samples{2};      // those at multiples of it, within the volume
};
// The finest with at most 128^3 samples. Nothing for a volume that has no more itself, and for one
// that is too thin.
std::optional<PreviewGrid> previewGridOf(const Index3& voxels);

// How the pyramid of a preview is built: quickly.
BuildOptions previewBuildOptions();

// Collects samples of level 1 as they come, and makes pyramids of them. T is the voxel type. One
// thread at a time. A failure to make one ends the making, and nothing else.
template <typename T>
class PreviewMaker {
 public:
  // `info` and `options`, with the same `options.preview`, are those of the build, which begins
  // now; they outlive the maker.
  PreviewMaker(const VolumeInfo& info, const PreviewGrid& grid, const BuildOptions& options);
  // Removes the preview that was published and is still there.
  ~PreviewMaker();
  PreviewMaker(const PreviewMaker&) = delete;
  PreviewMaker& operator=(const PreviewMaker&) = delete;

  // Samples of level 1, dense in `box`.
  void include(const IndexBox& box, const T* samples);
  // Publishes the samples so far, if the build can spare the time: all slices of level 1 below
  // `end` were included.
  void offer(std::int64_t end);

 private:
  bool isWorthIt(std::int64_t slices) const;
  void publish(std::int64_t slices);

  const VolumeInfo& info_;
  const BuildOptions& options_;
  const PreviewGrid grid_;
  std::vector<T> samples_;
  std::chrono::steady_clock::time_point begin_;
  double seconds_per_slice_;  // of making one
  double seconds_ = 0.0;      // of making all so far
  std::int64_t published_slices_ = 1;
  int number_ = 0;
  std::string path_;  // of the last one
  bool failed_ = false;
};

}  // namespace isobrick
