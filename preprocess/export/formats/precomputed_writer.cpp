#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/preprocess/export/neuroglancer_info.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

using OrderedJson = nlohmann::ordered_json;

constexpr std::int64_t kEdge = 64;  // voxels of a chunk, along each axis
constexpr double kNanometresInMillimetre = 1e6;

// One resolution of the volume. Its voxel i covers `step` voxels of the next finer one, from
// i * step on.
struct Scale {
  std::string key;
  Index3 voxels;
  Index3 step;
  glm::dvec3 nanometres;
};

// An axis whose voxels are at least twice as long as those of the shortest axis waits for the
// others; one of a single voxel counts no more.
std::vector<Scale> scalesOf(const VolumeInfo& info) {
  std::vector<Scale> scales{
      {"0", info.voxels, Index3(1), info.geometry.spacing * kNanometresInMillimetre}};
  while (true) {
    const Scale& finer = scales.back();
    if (std::max({finer.voxels.x, finer.voxels.y, finer.voxels.z}) <= kEdge) return scales;
    double least = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis)
      if (finer.voxels[axis] > 1) least = std::min(least, finer.nanometres[axis]);
    Scale scale{std::to_string(scales.size()), finer.voxels, Index3(1), finer.nanometres};
    for (int axis = 0; axis < 3; ++axis) {
      if (finer.voxels[axis] == 1 || finer.nanometres[axis] >= 2 * least) continue;
      scale.step[axis] = 2;
      scale.voxels[axis] = (finer.voxels[axis] + 1) / 2;
      scale.nanometres[axis] *= 2;
    }
    scales.push_back(std::move(scale));
  }
}

OrderedJson listOf(const glm::dvec3& v) { return {v.x, v.y, v.z}; }
OrderedJson listOf(const Index3& v) { return {v.x, v.y, v.z}; }

OrderedJson infoOf(const VolumeInfo& info, const std::vector<Scale>& scales) {
  OrderedJson listed = OrderedJson::array();
  for (const Scale& scale : scales)
    listed.push_back({{"key", scale.key},
                      {"size", listOf(scale.voxels)},
                      {"resolution", listOf(scale.nanometres)},
                      {"voxel_offset", listOf(Index3(0))},
                      {"chunk_sizes", {listOf(Index3(kEdge))}},
                      {"encoding", "raw"}});
  constexpr std::array kTypes{"uint8", "int8", "uint16", "int16", "float32"};
  return {{"@type", "neuroglancer_multiscale_volume"},
          {"type", "image"},
          {"data_type", kTypes.at(static_cast<std::size_t>(info.voxel_type))},
          {"num_channels", 1},
          {"scales", listed},
          {"isobrick", placeInWorld(info.geometry)}};
}

IndexBox chunkBox(const Scale& scale, const Index3& chunk) {
  const Index3 first = chunk * kEdge;
  return {first, glm::min(Index3(kEdge), scale.voxels - first)};
}

// "0-64_64-128_128-140" in the scale's folder: the voxels along x, y and z, each without its end.
std::string chunkName(const Scale& scale, const IndexBox& box) {
  std::string name = scale.key + "/";
  for (int axis = 0; axis < 3; ++axis) {
    if (axis > 0) name += '_';
    name += std::to_string(box.first[axis]) + "-" + std::to_string(box.end()[axis]);
  }
  return name;
}

template <typename T>
T meanOf(double sum, std::int64_t count) {
  const double mean = sum / static_cast<double>(count);
  if constexpr (std::is_integral_v<T>)
    return static_cast<T>(std::nearbyint(mean));
  else
    return static_cast<T>(mean);
}

class PrecomputedWriter {
 public:
  PrecomputedWriter(const VolumeSource& source, std::vector<Scale> scales, AtomicFolder& folder,
                    const ExportOptions& options)
      : source_(source), scales_(std::move(scales)), folder_(folder), options_(options) {
    for (const Scale& scale : scales_) total_ += chunksOf(scale);
  }

  // Returns the bytes written.
  std::uint64_t write() {
    writeFile(
        "info",
        infoOf(source_.info(), scales_).dump(2, ' ', false, OrderedJson::error_handler_t::replace) +
            "\n");
    visitVoxelType(source_.info().voxel_type, [&](auto tag) {
      for (std::size_t s = 0; s < scales_.size(); ++s) writeScale<typename decltype(tag)::Type>(s);
    });
    return bytes_;
  }

 private:
  static Index3 gridOf(const Scale& scale) { return BrickLayout::ceilDivide(scale.voxels, kEdge); }
  static std::int64_t chunksOf(const Scale& scale) { return elementCount(gridOf(scale)); }

  template <typename T>
  void writeScale(std::size_t s) {
    const Scale& scale = scales_[s];
    const Index3 grid = gridOf(scale);
    folder_.makeFolder(scale.key);
    isolatedFor(std::int64_t{0}, chunksOf(scale), [&](std::int64_t i) {
      checkCancel(options_);
      const IndexBox box =
          chunkBox(scale, {i % grid.x, i / grid.x % grid.y, i / (grid.x * grid.y)});
      std::vector<T> chunk(static_cast<std::size_t>(box.size()));
      if (s == 0)
        source_.readBox(box, chunk.data());
      else
        reduce(s, box, chunk.data());
      writeFile(chunkName(scale, box), chunk);
      const std::lock_guard lock(mutex_);
      ++done_;
      if (options_.progress)
        options_.progress(static_cast<double>(done_) / static_cast<double>(total_));
    });
  }

  // Each voxel becomes the mean of those that it covers: of the chunks of the finer scale, which
  // are there by now.
  template <typename T>
  void reduce(std::size_t s, const IndexBox& box, T* out) const {
    const Scale& finer = scales_[s - 1];
    const Index3 step = scales_[s].step;
    const Index3 first = box.first * step / kEdge;
    const Index3 end = glm::min(BrickLayout::ceilDivide(box.end() * step, kEdge), gridOf(finer));
    std::vector<T> voxels;
    for (std::int64_t z = first.z; z < end.z; ++z)
      for (std::int64_t y = first.y; y < end.y; ++y)
        for (std::int64_t x = first.x; x < end.x; ++x) {
          const IndexBox from = chunkBox(finer, {x, y, z});
          voxels.resize(static_cast<std::size_t>(from.size()));
          readFile(chunkName(finer, from), voxels);
          reduceChunk(SampleBlock<T>::dense(voxels.data(), from), from, step, out, box);
        }
  }

  // Chunks begin at even voxels, so that no voxel covers parts of two.
  template <typename T>
  static void reduceChunk(const SampleBlock<T>& voxels, const IndexBox& from, const Index3& step,
                          T* out, const IndexBox& box) {
    const Index3 begin = from.first / step;
    const Index3 end = (from.end() + step - Index3(1)) / step;
    for (std::int64_t z = begin.z; z < end.z; ++z)
      for (std::int64_t y = begin.y; y < end.y; ++y)
        for (std::int64_t x = begin.x; x < end.x; ++x) {
          const Index3 low = Index3(x, y, z) * step;
          const Index3 high = glm::min(low + step, from.end());
          double sum = 0;
          for (std::int64_t k = low.z; k < high.z; ++k)
            for (std::int64_t j = low.y; j < high.y; ++j)
              for (std::int64_t i = low.x; i < high.x; ++i)
                sum += static_cast<double>(voxels.at({i, j, k}));
          out[linearIndex(Index3(x, y, z) - box.first, box.count)] =
              meanOf<T>(sum, elementCount(high - low));
        }
  }

  template <typename Bytes>
  void writeFile(const std::string& name, const Bytes& data) {
    const std::size_t bytes = data.size() * sizeof data[0];
    folder_.writeFile(name, data.data(), bytes);
    bytes_ += bytes;
  }

  template <typename T>
  void readFile(const std::string& name, std::vector<T>& out) const {
    const InputFile file(folder_.temporaryPath() + "/" + name);
    const std::size_t bytes = out.size() * sizeof(T);
    if (file.readAt(0, out.data(), bytes) != bytes)
      throw Error("'" + file.path() + "' is shorter than it was written; let no other program " +
                      "write there, and start again",
                  {.path = file.path()});
  }

  const VolumeSource& source_;
  const std::vector<Scale> scales_;
  AtomicFolder& folder_;
  const ExportOptions& options_;
  std::mutex mutex_;
  std::int64_t done_ = 0, total_ = 0;  // chunks
  std::atomic<std::uint64_t> bytes_{0};
};

}  // namespace

VolumeWriteReport writePrecomputed(VolumeLevels& levels, const std::string& path,
                                   const ExportOptions& options) {
  std::unique_ptr<VolumeSource>& source = levels.front();
  VolumeWriteReport report;
  report.space = "index axes";
  report.lost = neuroglancerLosses(source->info().geometry);
  AtomicFolder folder(path);
  makeReadBoxes(source, folderOf(folder.temporaryPath()), options);
  report.bytes = PrecomputedWriter(*source, scalesOf(source->info()), folder, options).write();
  if (options.before_publishing) options.before_publishing();
  folder.commit(options.cancel);
  return report;
}

}  // namespace isobrick
