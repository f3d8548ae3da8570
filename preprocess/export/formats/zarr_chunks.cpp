#include "isobrick/preprocess/export/formats/zarr_chunks.h"

#include <blosc.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <vector>

#include "isobrick/preprocess/crc32c.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

constexpr std::int64_t kVoxelsOfChunk = kZarrChunkVoxels * kZarrChunkVoxels * kZarrChunkVoxels;

using Bytes = std::vector<std::byte>;

// One chunk, with zeros if it reaches beyond the volume; empty if it has nothing else.
template <typename T>
std::vector<T> readChunk(const VolumeSource& source, const Index3& first) {
  const Index3 count = glm::min(Index3(kZarrChunkVoxels), source.info().voxels - first);
  const IndexBox box{first, count};
  std::vector<T> inside(static_cast<std::size_t>(box.size()));
  source.readBox(box, inside.data());
  if (std::ranges::all_of(inside, [](T v) { return v == T{}; })) return {};
  if (box.size() == kVoxelsOfChunk) return inside;
  std::vector<T> whole(static_cast<std::size_t>(kVoxelsOfChunk), T{});
  copyBox(SampleBlock<T>::dense(inside.data(), box), box, whole.data(),
          {first, Index3(kZarrChunkVoxels)});
  return whole;
}

// Empty if it is all 0.
Bytes packedChunk(const VolumeSource& source, const Index3& chunk, const ZarrPacking& packing) {
  Bytes packed;
  visitNumberType(source.info().voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    const std::vector<T> voxels = readChunk<T>(source, chunk * kZarrChunkVoxels);
    if (voxels.empty()) return;
    const std::size_t bytes = voxels.size() * sizeof(T);
    packed.resize(bytes + BLOSC_MAX_OVERHEAD);
    constexpr int kThreads = 1;
    const int size =
        blosc_compress_ctx(packing.level, BLOSC_SHUFFLE, sizeof(T), bytes, voxels.data(),
                           packed.data(), packed.size(), packing.codec, 0, kThreads);
    if (size <= 0) throw std::logic_error("Blosc packs nothing");
    packed.resize(static_cast<std::size_t>(size));
  });
  return packed;
}

// One shard, whose file is there as soon as it has a chunk.
class ShardWriter {
 public:
  ShardWriter(AtomicFolder& folder, std::string name, std::int64_t chunks)
      : folder_(folder),
        name_(std::move(name)),
        index_(2 * static_cast<std::size_t>(chunks), ~std::uint64_t{0}) {}

  // `chunk` is the number of its row in the index.
  void append(std::int64_t chunk, const Bytes& packed) {
    if (!file_) {
      folder_.makeFolder(name_.substr(0, name_.rfind('/')));
      file_.emplace(folder_, name_);
    }
    const auto row = 2 * static_cast<std::size_t>(chunk);
    index_[row] = bytes_;
    index_[row + 1] = packed.size();
    write(packed);
  }
  // Returns the bytes of the file.
  std::uint64_t finish() {
    static_assert(std::endian::native == std::endian::little, "as the index is stored");
    if (!file_) return 0;
    const auto index = std::as_bytes(std::span(index_));
    const std::uint32_t checksum = crc32c(index);
    write(index);
    write(std::as_bytes(std::span(&checksum, 1)));
    file_->close();
    return bytes_;
  }

 private:
  void write(std::span<const std::byte> bytes) {
    file_->append(bytes.data(), bytes.size());
    bytes_ += bytes.size();
  }

  AtomicFolder& folder_;
  const std::string name_;
  std::vector<std::uint64_t> index_;  // offset and bytes of each chunk
  std::optional<AtomicFolder::File> file_;
  std::uint64_t bytes_ = 0;
};

}  // namespace

Index3 zarrShardOf(const VolumeInfo& info, const ExportOptions& options) {
  const Index3 chunks = BrickLayout::ceilDivide(info.voxels, kZarrChunkVoxels);
  return glm::min(Index3(options.zarr_shard / kZarrChunkVoxels), chunks) * kZarrChunkVoxels;
}

Index3 zarrShardsOf(const VolumeInfo& info, const ExportOptions& options) {
  return (info.voxels - Index3(1)) / zarrShardOf(info, options) + Index3(1);
}

std::uint64_t writeZarrChunks(const VolumeSource& source, AtomicFolder& folder,
                              const std::string& level, const ExportOptions& options,
                              const ZarrTick& tick) {
  const Index3 chunks = BrickLayout::ceilDivide(source.info().voxels, kZarrChunkVoxels);
  std::atomic<std::uint64_t> bytes{0};
  std::mutex mutex;
  std::int64_t rows_done = 0;
  // A row of chunks at a time: they are neighbours in the source, and in one folder.
  isolatedFor(std::int64_t{0}, chunks.y * chunks.z, [&](std::int64_t row) {
    const std::int64_t y = row % chunks.y, z = row / chunks.y;
    const std::string place = concat(level, "/", z, "/", y);
    bool has_folder = false;
    for (std::int64_t x = 0; x < chunks.x; ++x) {
      checkCancel(options);
      const Bytes packed = packedChunk(source, {x, y, z}, kZarr2Packing);
      if (packed.empty()) continue;
      if (!has_folder) folder.makeFolder(place);
      has_folder = true;
      folder.writeFile(concat(place, "/", x), packed.data(), packed.size());
      bytes += packed.size();
    }
    const std::lock_guard lock(mutex);
    tick(static_cast<double>(++rows_done) / static_cast<double>(chunks.y * chunks.z));
  });
  return bytes;
}

std::uint64_t writeZarrShards(const VolumeSource& source, AtomicFolder& folder,
                              const std::string& level, const ExportOptions& options,
                              const NumberRun& numbers, const ZarrTick& tick) {
  const VolumeInfo& info = source.info();
  const Index3 chunks = BrickLayout::ceilDivide(info.voxels, kZarrChunkVoxels);
  const Index3 per_shard = zarrShardOf(info, options) / kZarrChunkVoxels;
  // Of each that is being made: its voxels, those of them within the volume, and its bytes.
  const std::uint64_t room =
      3 * static_cast<std::uint64_t>(kVoxelsOfChunk) * voxelBytes(info.voxel_type);
  constexpr std::uint64_t kMostAtOnce = 256;
  std::vector<Bytes> packed(std::clamp<std::uint64_t>(options.memory_bytes / room, 1, kMostAtOnce));
  std::uint64_t bytes = 0;
  for (std::size_t done = 0; done < numbers.count; ++done) {
    const Index3 at =
        indexAt(static_cast<std::int64_t>(numbers.first + done), zarrShardsOf(info, options));
    const Index3 first = at * per_shard;
    const Index3 count = glm::min(per_shard, chunks - first);
    ShardWriter shard(folder, concat(level, "/c/", at.z, "/", at.y, "/", at.x),
                      elementCount(per_shard));
    const std::int64_t all = elementCount(count);
    source.announce(std::array{intersectionOf({first * kZarrChunkVoxels, count * kZarrChunkVoxels},
                                              {Index3(0), info.voxels})});
    for (std::int64_t begin = 0; begin < all;) {
      const std::int64_t batch = std::min(all - begin, static_cast<std::int64_t>(packed.size()));
      isolatedForEach(std::int64_t{0}, batch, [&](std::int64_t i) {
        checkCancel(options);
        packed[static_cast<std::size_t>(i)] =
            packedChunk(source, first + indexAt(begin + i, count), kZarr3Packing);
      });
      for (std::int64_t i = 0; i < batch; ++i) {
        Bytes& one = packed[static_cast<std::size_t>(i)];
        if (!one.empty()) shard.append(linearIndex(indexAt(begin + i, count), per_shard), one);
        Bytes().swap(one);
      }
      begin += batch;
      tick((static_cast<double>(done) + static_cast<double>(begin) / static_cast<double>(all)) /
           static_cast<double>(numbers.count));
    }
    bytes += shard.finish();
  }
  return bytes;
}

}  // namespace isobrick
