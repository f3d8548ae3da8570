// The chunks of one level of an OME-Zarr: packed in parallel, each in a file of its own or many in
// a shard. Private to preprocess/export/formats/.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Voxels along an edge of a chunk.
inline constexpr std::int64_t kZarrChunkVoxels = 64;

// How Blosc packs a chunk.
struct ZarrPacking {
  const char* codec;  // "lz4"
  int level;
};
inline constexpr ZarrPacking kZarr2Packing{"lz4", 5};
// A CT takes 26 % more by Zstandard without Blosc's shuffle, and 2 % less by its level 3.
inline constexpr ZarrPacking kZarr3Packing{"zstd", 1};

// The voxels of a shard of `source`: as options.zarr_shard asks, and no more chunks along an axis
// than the volume has.
Index3 zarrShardOf(const VolumeInfo& info, const ExportOptions& options);

// Shards of that size along each axis.
Index3 zarrShardsOf(const VolumeInfo& info, const ExportOptions& options);

// Both write into the folder `level` of the output, which is there. Chunks and shards of nothing
// but 0 are left out. `tick` is called with the share of the level that is done, by one thread at a
// time. Return the bytes written. Throw what the source and AtomicFolder throw, and Cancelled.
using ZarrTick = std::function<void(double share)>;

// Zarr 2: "z/y/x" for each chunk.
std::uint64_t writeZarrChunks(const VolumeSource& source, AtomicFolder& folder,
                              const std::string& level, const ExportOptions& options,
                              const ZarrTick& tick);
// Zarr 3: "c/z/y/x" for each shard, one after another, with its index at the end. The chunks of a
// shard are packed side by side, as many as options.memory_bytes has room for, and lie in the file
// in the order of the index: its bytes depend neither on threads nor on memory. Only those shards
// that `numbers` has, x fastest.
std::uint64_t writeZarrShards(const VolumeSource& source, AtomicFolder& folder,
                              const std::string& level, const ExportOptions& options,
                              const NumberRun& numbers, const ZarrTick& tick);

}  // namespace isobrick
