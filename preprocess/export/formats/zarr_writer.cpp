#include <blosc.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

// Keys stay in the order in which they are put.
using Json = nlohmann::ordered_json;

constexpr std::int64_t kZarrChunkVoxels = 64;

// Slowest axis first, as Zarr and OME have it.
template <typename V>
Json slowestFirst(const V& v) {
  return {v.z, v.y, v.x};
}

std::string typeName(VoxelType type) {
  return std::array{"|u1", "|i1", "<u2", "<i2", "<f4", "<u8", "<i8", "<u4", "<i4", "<f8"}
      [static_cast<std::size_t>(type)];
}

std::string jsonText(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Json arrayMetadata(const VolumeInfo& info) {
  return {{"zarr_format", 2},
          {"shape", slowestFirst(info.voxels)},
          {"chunks", slowestFirst(Index3(kZarrChunkVoxels))},
          {"dtype", typeName(info.voxel_type)},
          {"compressor",
           {{"id", "blosc"}, {"cname", "lz4"}, {"clevel", 5}, {"shuffle", 1}, {"blocksize", 0}}},
          {"fill_value", 0},
          {"order", "C"},
          {"filters", nullptr},
          {"dimension_separator", "/"}};
}

Json imageMetadata(const VolumeLevels& levels) {
  const VolumeInfo& finest = levels.front()->info();
  Json axes = Json::array();
  for (const char* name : {"z", "y", "x"}) {
    axes.push_back({{"name", name}, {"type", "space"}});
    if (finest.geometry.unit == LengthUnit::kMillimetre) axes.back()["unit"] = "millimeter";
  }
  Json datasets = Json::array();
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const GridGeometry& geometry = levels[i]->info().geometry;
    datasets.push_back(
        {{"path", std::to_string(i)},
         {"coordinateTransformations",
          {{{"type", "scale"}, {"scale", slowestFirst(geometry.spacing)}},
           {{"type", "translation"}, {"translation", slowestFirst(geometry.origin)}}}}});
  }
  Json columns = Json::array();
  for (int axis = 0; axis < 3; ++axis) {
    const glm::dvec3 column = finest.geometry.direction[axis];
    columns.push_back({column.x, column.y, column.z});
  }
  return {{"multiscales",
           {{{"version", "0.4"},
             {"name", std::filesystem::path(finest.source).stem().string()},
             {"axes", axes},
             {"datasets", datasets}}}},
          {"isobrick", {{"space", "LPS"}, {"direction", columns}, {"source", finest.source}}}};
}

// One chunk, with zeros if it reaches beyond the volume.
template <typename T>
bool fillChunk(const VolumeSource& source, const Index3& first, std::vector<T>& chunk,
               std::vector<T>& inside) {
  const Index3 count = glm::min(Index3(kZarrChunkVoxels), source.info().voxels - first);
  const IndexBox box{first, count};
  const bool is_whole = count == Index3(kZarrChunkVoxels);
  std::vector<T>& to = is_whole ? chunk : inside;
  to.resize(static_cast<std::size_t>(box.size()));
  source.readBox(box, to.data());
  const bool is_empty = std::all_of(to.begin(), to.end(), [](T v) { return v == T{}; });
  if (is_whole || is_empty) return !is_empty;
  chunk.assign(static_cast<std::size_t>(kZarrChunkVoxels * kZarrChunkVoxels * kZarrChunkVoxels),
               T{});
  copyBox(SampleBlock<T>::dense(inside.data(), box), box, chunk.data(),
          {first, Index3(kZarrChunkVoxels)});
  return true;
}

class LevelWriter {
 public:
  LevelWriter(const VolumeSource& source, AtomicFolder& folder, std::string name,
              const ExportOptions& options)
      : source_(source), folder_(folder), name_(std::move(name)), options_(options) {}

  // Calls `tick` with the share that is done, by one thread at a time. Returns the bytes written.
  std::uint64_t write(const std::function<void(double)>& tick) {
    const VolumeInfo& info = source_.info();
    const Index3 chunks = BrickLayout::ceilDivide(info.voxels, kZarrChunkVoxels);
    folder_.makeFolder(name_);
    writeText(".zarray", jsonText(arrayMetadata(info)));
    std::mutex mutex;
    std::int64_t rows_done = 0;
    // A row of chunks at a time: they are neighbours in the source, and in one folder.
    isolatedFor(std::int64_t{0}, chunks.y * chunks.z, [&](std::int64_t row) {
      const std::int64_t y = row % chunks.y, z = row / chunks.y;
      const std::string folder = concat(z, "/", y);
      bool has_folder = false;
      visitNumberType(info.voxel_type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        std::vector<T> chunk, inside;
        for (std::int64_t x = 0; x < chunks.x; ++x) {
          checkCancel(options_);
          if (!fillChunk(source_, Index3(x, y, z) * kZarrChunkVoxels, chunk, inside)) continue;
          if (!has_folder) folder_.makeFolder(name_ + "/" + folder);
          has_folder = true;
          writeChunk(folder + "/" + std::to_string(x), chunk.data(), chunk.size() * sizeof(T),
                     sizeof(T));
        }
      });
      const std::lock_guard lock(mutex);
      tick(static_cast<double>(++rows_done) / static_cast<double>(chunks.y * chunks.z));
    });
    return bytes_;
  }

 private:
  void writeText(const std::string& name, const std::string& text) {
    folder_.writeFile(name_ + "/" + name, text.data(), text.size());
    bytes_ += text.size();
  }

  void writeChunk(const std::string& name, const void* voxels, std::size_t bytes,
                  std::size_t voxel_bytes) {
    std::vector<std::byte> packed(bytes + BLOSC_MAX_OVERHEAD);
    constexpr int kLevel = 5, kThreads = 1;
    const int size = blosc_compress_ctx(kLevel, BLOSC_SHUFFLE, voxel_bytes, bytes, voxels,
                                        packed.data(), packed.size(), "lz4", 0, kThreads);
    if (size <= 0) throw std::logic_error("Blosc packs nothing");
    folder_.writeFile(name_ + "/" + name, packed.data(), static_cast<std::size_t>(size));
    bytes_ += static_cast<std::uint64_t>(size);
  }

  const VolumeSource& source_;
  AtomicFolder& folder_;
  std::string name_;  // of the level
  const ExportOptions& options_;
  std::atomic<std::uint64_t> bytes_{0};
};

}  // namespace

VolumeWriteReport writeOmeZarr(VolumeLevels& levels, const std::string& path,
                               const ExportOptions& options) {
  VolumeWriteReport report;
  report.space = "LPS";
  if (levels.front()->info().geometry.direction != glm::dmat3(1.0))
    report.lost.push_back(
        "OME-Zarr 0.4 has no direction; it is kept in the attribute 'isobrick', "
        "which other programs ignore");
  AtomicFolder folder(path);
  const auto writeText = [&](const char* name, const std::string& text) {
    folder.writeFile(name, text.data(), text.size());
    report.bytes += text.size();
  };
  writeText(".zgroup", jsonText({{"zarr_format", 2}}));
  writeText(".zattrs", jsonText(imageMetadata(levels)));
  double total = 0, before = 0;
  for (const auto& level : levels) total += static_cast<double>(volumeBytes(level->info()));
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const double share = static_cast<double>(volumeBytes(levels[i]->info()));
    makeReadBoxes(levels[i], folderOf(folder.temporaryPath()), options);
    report.bytes +=
        LevelWriter(*levels[i], folder, std::to_string(i), options).write([&](double d) {
          if (options.progress) options.progress((before + share * d) / total);
        });
    before += share;
  }
  if (options.before_publishing) options.before_publishing();
  folder.commit(options.cancel);
  return report;
}

}  // namespace isobrick
