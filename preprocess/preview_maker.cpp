#include "isobrick/preprocess/preview_maker.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <glm/common.hpp>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

constexpr std::int64_t kMostSamples = std::int64_t{1} << 21;
// The assumption until a first one was made.
constexpr double kSecondsPerSample = 20e-9;
// The first one may take this long before any time was saved for it.
constexpr double kFirstSeconds = 0.02;
constexpr int kMostThreads = 4;

// The first slices of a preview.
class PreviewSource final : public VolumeSource {
 public:
  PreviewSource(VolumeInfo info, const std::byte* samples)
      : info_(std::move(info)), samples_(samples) {}

  const VolumeInfo& info() const override { return info_; }
  std::string identity() const override { return info_.source; }
  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override {
    auto* to = static_cast<std::byte*>(out);
    const std::int64_t row = box.count.x * bytes();
    for (std::int64_t z = box.first.z; z < box.end().z; ++z)
      for (std::int64_t y = box.first.y; y < box.end().y; ++y, to += row)
        std::copy_n(samples_ + linearIndex({box.first.x, y, z}, info_.voxels) * bytes(), row, to);
  }

 private:
  std::int64_t bytes() const { return static_cast<std::int64_t>(voxelBytes(info_.voxel_type)); }

  const VolumeInfo info_;
  const std::byte* const samples_;
};

}  // namespace

std::optional<PreviewGrid> previewGridOf(const Index3& voxels) {
  if (elementCount(voxels) <= kMostSamples) return std::nullopt;
  PreviewGrid grid;
  while (true) {
    grid.samples = (voxels - Index3(1)) / grid.step + Index3(1);
    if (std::min({grid.samples.x, grid.samples.y, grid.samples.z}) < 2) return std::nullopt;
    if (elementCount(grid.samples) <= kMostSamples) return grid;
    grid.step *= 2;
  }
}

BuildOptions previewBuildOptions() {
  BuildOptions options;
  options.brick_cells = 32;
  options.codec = format::Codec::kStored;
  options.with_curvature = false;
  return options;
}

template <typename T>
PreviewMaker<T>::PreviewMaker(const VolumeInfo& info, const PreviewGrid& grid,
                              const BuildOptions& options)
    : info_(info),
      options_(options),
      grid_(grid),
      samples_(static_cast<std::size_t>(elementCount(grid.samples))),
      begin_(std::chrono::steady_clock::now()),
      seconds_per_slice_(kSecondsPerSample * static_cast<double>(grid.samples.x * grid.samples.y)) {
}

template <typename T>
PreviewMaker<T>::~PreviewMaker() {
  if (!path_.empty()) removeName(path_);
}

template <typename T>
void PreviewMaker<T>::include(const IndexBox& box, const T* samples) {
  const std::int64_t stride = grid_.step / 2;  // in level 1
  const Index3 first = BrickLayout::ceilDivide(box.first, stride);
  const Index3 end = glm::min(BrickLayout::ceilDivide(box.end(), stride), grid_.samples);
  for (std::int64_t z = first.z; z < end.z; ++z)
    for (std::int64_t y = first.y; y < end.y; ++y) {
      const Index3 begin = Index3(0, y, z) * stride - Index3(0, box.first.y, box.first.z);
      const std::int64_t from = linearIndex(begin, box.count) - box.first.x;
      T* const to = samples_.data() + linearIndex({0, y, z}, grid_.samples);
      for (std::int64_t x = first.x; x < end.x; ++x) to[x] = samples[from + x * stride];
    }
}

template <typename T>
void PreviewMaker<T>::offer(std::int64_t end) {
  const std::int64_t slices =
      std::min(BrickLayout::ceilDivide(Index3(end), grid_.step / 2).z, grid_.samples.z);
  if (failed_ || slices <= published_slices_ || !isWorthIt(slices)) return;
  const auto begin = std::chrono::steady_clock::now();
  try {
    publish(slices);
  } catch (const std::exception&) {  // the build itself fails, if it must, by itself
    failed_ = true;
  }
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  seconds_ += seconds;
  seconds_per_slice_ = seconds / static_cast<double>(slices);
}

template <typename T>
bool PreviewMaker<T>::isWorthIt(std::int64_t slices) const {
  const double share = options_.preview.most_share;
  if (share <= 0.0 || share >= 1.0) return share > 0.0;
  const double needed = seconds_per_slice_ * static_cast<double>(slices);
  if (number_ == 0 && needed <= kFirstSeconds) return true;
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - begin_;
  return seconds_ + needed <= share * elapsed.count();
}

template <typename T>
void PreviewMaker<T>::publish(std::int64_t slices) {
  VolumeInfo info;
  info.voxels = {grid_.samples.x, grid_.samples.y, slices};
  info.voxel_type = info_.voxel_type;
  info.values = info_.values;
  info.geometry = info_.geometry;
  info.geometry.spacing *= static_cast<double>(grid_.step);
  info.source = concat("preview ", ++number_, " of ", info_.source);
  info.format = "preview";
  PreviewSource source(std::move(info), reinterpret_cast<const std::byte*>(samples_.data()));
  BuildOptions options = previewBuildOptions();
  options.tool_version = options_.tool_version;
  options.memory_bytes = kPreviewBytes - static_cast<std::uint64_t>(kMostSamples) * sizeof(T);
  options.cancel = options_.cancel;
  const std::string path =
      (std::filesystem::path(options_.preview.folder) / (std::to_string(number_) + ".isb"))
          .string();
  tbb::task_arena arena(std::min(tbb::this_task_arena::max_concurrency(), kMostThreads));
  arena.execute([&] { buildPyramid(source, path, options); });
  // A viewer that got the path of the previous one has opened it by now, or takes this one.
  if (!path_.empty()) removeName(path_);
  path_ = path;
  published_slices_ = slices;
  if (options_.preview.published) options_.preview.published({path, grid_.step, info_.voxels});
}

#define ISOBRICK_INSTANTIATE(T) template class PreviewMaker<T>;
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
