// One array of a Zarr store (version 2 or 3), in a folder, a zip file or behind a URL. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/sources/unpack_block.h"
#include "isobrick/preprocess/sources/zarr_remote.h"
#include "isobrick/preprocess/sources/zarr_store.h"

namespace isobrick {

// What was done to the numbers of a chunk before it was packed.
struct ZarrFilter {
  // kDelta: from the second on, the difference to the number before, as `packed`.
  // kShuffle: the first bytes of all numbers, then the second ones, and so on.
  enum class Kind { kDelta, kShuffle };

  Kind kind = Kind::kShuffle;
  std::size_t shuffled_bytes = 1;  // of a number
  StoredVoxels packed, unpacked;   // of kDelta; both integers or both floats

  // Of as many numbers as `bytes` unpacked bytes have.
  std::size_t packedBytes(std::size_t bytes) const {
    return kind == Kind::kDelta ? bytes / unpacked.bytes() * packed.bytes() : bytes;
  }
};

// Undoes a filter; `out` becomes `bytes` long, of which `packed` has filter.packedBytes().
void undoZarrFilter(const ZarrFilter& filter, std::span<const std::byte> packed, std::size_t bytes,
                    std::vector<std::byte>& out);

// A JSON file of a store, which may be hostile: at most 16 MiB, not nested deeper than 32. Throws
// Error for text that is no JSON object.
nlohmann::json readZarrJson(const std::string& path);

// An array of up to 5 axes, the slowest first, as its metadata say. Chunks are the units that are
// packed: of a sharded array the inner ones. All members are thread-safe.
class ZarrArray {
 public:
  using Indices = std::vector<std::int64_t>;

  // Reads `folder`/.zarray or `folder`/zarr.json. Throws Error for a file that is missing, damaged,
  // or of a kind that is not read (the message says which), and for chunks of more than 1 GiB.
  explicit ZarrArray(const std::string& folder);

  const Indices& shape() const { return shape_; }
  const Indices& chunk() const { return chunk_; }
  // Names of the axes, if the array has them (version 3).
  const std::vector<std::string>& axisNames() const { return axis_names_; }
  const StoredVoxels& stored() const { return stored_; }
  // Elements from one index to the next along each axis, within a chunk.
  const Indices& strides() const { return strides_; }
  // For a chunk as readChunk() gives it.
  std::uint64_t chunkBytes() const;

  // All elements of a chunk, those beyond the array's end too, as stored().delivered() voxels; the
  // fill value, and returns false, if the store has no such chunk. Throws Error that names the file
  // if it is damaged or cannot be opened.
  bool readChunk(const Indices& index, std::vector<std::byte>& out) const;
  double fill() const { return fill_; }

  // Whether it lies behind a URL.
  bool isRemote() const {
    return remote_ != nullptr || (zip_ != nullptr && zip_->file() == nullptr);
  }
  // Of an array behind a URL: asks for these chunks, which will be read soon, all at once. Waits
  // for the indices of shards alone. Throws what readChunk() throws.
  void announce(std::span<const Indices> chunks) const;

  // The metadata, and the files that hold voxels with `fixed` at every axis that is not negative
  // there: all that exist, or, of more than some ten thousand, a selection, evenly spread.
  std::vector<std::string> files(const Indices& fixed) const;

 private:
  // How a chunk becomes bytes, as far as is read: permuted axes, then filters, then at most one
  // packer, with checksums before and after it.
  struct Pipeline {
    std::vector<ZarrFilter> filters;  // in the order of writing
    BlockCodec codec = BlockCodec::kNone;
    int checksums_before = 0, checksums_after = 0;
  };
  // Chunks, or smaller shards, behind one another with a table of their places.
  struct Shard {
    Indices shape;
    bool index_at_start = false, index_has_checksum = false;
  };
  struct ByteRun {
    std::uint64_t offset = 0, bytes = 0;
  };

  void readVersion2(const nlohmann::json& json);
  void readVersion3(const nlohmann::json& json);
  Pipeline readCodecs(const nlohmann::json& codecs);
  void readShard(const nlohmann::json& configuration);
  void readFilters(const nlohmann::json& filters);
  bool takeFilter(const std::string& name, const nlohmann::json& configuration, Pipeline& pipeline);
  StoredVoxels numpyType(const nlohmann::json& name) const;
  void takeShape(const nlohmann::json& json, const char* key, Indices& out);
  StoredType typeNamed(const std::string& name) const;
  void setOrder(const Indices& slowest_first);
  void setFill(const nlohmann::json& json);
  void takeSeparator(const nlohmann::json& json, const char* key);
  void checkSizes();
  std::string pathOf(const Indices& outer) const;
  std::size_t storedChunkBytes() const;
  void unpack(const std::string& path, std::vector<std::byte> packed,
              std::vector<std::byte>& out) const;
  std::size_t filteredChunkBytes() const;
  Indices chunksOf(std::size_t shard) const;  // along each axis
  Indices outerOf(const Indices& index) const;
  FirstRequest firstRequest() const;
  std::optional<StoreFile> openOuter(const std::string& path) const;
  ByteRun tableOf(const StoreFile& file, std::size_t shard, const ByteRun& run) const;
  std::optional<ByteRun> findInShard(const StoreFile& file, std::size_t shard, ByteRun run,
                                     const Indices& index) const;
  bool readPacked(const std::string& path, const Indices& index, std::vector<std::byte>& out) const;
  void throwIfStoreWentAway() const;
  [[noreturn]] void refuse(const std::string& reason) const;

  std::shared_ptr<const ZipFile> zip_;   // held, so that its table is read once; may be null
  std::shared_ptr<RemoteStore> remote_;  // likewise, for its connections
  std::string folder_, metadata_path_;
  Indices shape_;
  Indices chunk_;  // the unit that is packed
  Indices outer_;  // the unit in a file: chunk_, or a shard of chunks
  Indices strides_;
  Indices order_;  // axes, slowest first
  std::vector<std::string> axis_names_;
  StoredVoxels stored_;
  double fill_ = 0;
  Pipeline pipeline_;
  std::vector<Shard> shards_;  // from the outermost, which is a file, to the innermost
  std::string key_prefix_;     // of chunk files
  char separator_ = '.';
};

}  // namespace isobrick
