// Reading a pyramid: a validated `.isb` file, local or behind a URL, whose bricks come and go.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_info.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/storage/voxel_histogram.h"

namespace isobrick {

class BrickPager;
class BrickSupply;
class PyramidTables;
class PyramidParts;

// The hold on one part of a brick: in the file's map if it is stored as it is, in a buffer if it
// was unpacked or made. The memory that data() returns is aligned to 16 bytes at least, and stays
// valid and unchanged as long as this object lives. Movable; used by one thread at a time; the
// pyramid outlives it.
class BrickPart {
 public:
  // Holds nothing.
  BrickPart() = default;
  BrickPart(BrickPart&& other) noexcept { swap(other); }
  BrickPart& operator=(BrickPart&& other) noexcept {
    swap(other);
    return *this;
  }
  ~BrickPart();

  // The part's first byte; null if nothing is held.
  const std::byte* data() const { return data_; }

 private:
  friend class PyramidParts;
  void swap(BrickPart& other) noexcept {
    std::swap(pager_, other.pager_);
    std::swap(id_, other.id_);
    std::swap(data_, other.data_);
    std::swap(made_, other.made_);
  }

  BrickPager* pager_ = nullptr;  // null if the bytes were made rather than read
  std::size_t id_ = 0;
  const std::byte* data_ = nullptr;
  std::unique_ptr<std::byte[]> made_;
};

// The samples of one brick.
struct BrickSamples {
  IndexBox box;    // in samples of the level
  BrickPart part;  // box.size() samples of the pyramid's voxel type, x fastest

  // The first of the samples. T: the pyramid's voxel type (visitVoxelType() leads to it).
  template <typename T>
  const T* data() const {
    return reinterpret_cast<const T*>(part.data());
  }
};

// An open pyramid. All const members are thread-safe; bricks may be held by any number of threads.
//
// The file should not be changed while it is open. If it is cut short all the same, or its disk
// fails, acquiring a brick whose bytes are lost, or throwIfReadsFailed() after its use, throws
// Error, and nothing crashes; other bricks stay what they were. An extraction from a file that is
// written to meanwhile ends with Error. If another file takes this one's name, this one stays as it
// was.
//
// Members that take a brick: `level` is 0 .. lattice().levels() - 1, and `brick` lies in
// layout().bricks(level); neither is checked. They throw Error, which names the brick, if its entry
// in the brick table is damaged or cannot be read.
class Pyramid {
 public:
  // The budget of a pyramid that is opened without one: 1 GiB.
  static constexpr std::uint64_t kDefaultBudgetBytes = std::uint64_t{1} << 30;

  // Opens and validates header, level table and provenance: sizes, offsets and checksums. Reads no
  // brick. So opening takes as long for any number of bricks; a brick is checked when it is first
  // asked for. `budget_bytes` bounds the memory of bricks, mapped and unpacked. Bricks in use stay
  // even if they exceed it. With FileAccess::kRead nothing is mapped: all bytes are read, which
  // suits network file systems, and a change of the file does not touch the bytes that were read.
  // Results are the same. Throws Error if the file is not a pyramid, was truncated, is damaged or
  // of a newer version.
  //
  // `path` may be a URL: http://, https://, or s3://bucket/key. Then every part is asked of the
  // server as a range of bytes when it is needed, many at once, and repeated if a failure may pass;
  // on top of the budget come at most 64 MiB that are on their way. A server that does not serve
  // ranges is refused, and if the file changes while it is open, calls that need it throw Error.
  explicit Pyramid(const std::string& path, std::uint64_t budget_bytes = kDefaultBudgetBytes,
                   FileAccess access = FileAccess::kMap, const RemoteOptions& remote = {});
  // For the library itself (storage/brick_supply.h): level 0 alone, which lies elsewhere. Bricks
  // come from `supply` when they are asked for. Nothing else is stored: members about the file
  // give nothing, and those about coarser levels must not be called. `values` are the least and the
  // greatest voxel, or bounds of them.
  Pyramid(std::string name, const PyramidSpec& spec, const ValueRange& values,
          std::shared_ptr<const BrickSupply> supply);
  ~Pyramid();

  // The name that it was opened by; a URL without password and query.
  const std::string& path() const;
  // Voxels, their type, geometry, and how the file is cut into bricks.
  const PyramidSpec& spec() const { return spec_; }
  // The places of bricks.
  const BrickLayout& layout() const { return layout_; }
  // The places of samples, and the number of levels.
  const Lattice& lattice() const { return layout_.lattice(); }
  // Least and greatest voxel of level 0, as they are stored.
  const ValueRange& valueRange() const { return value_range_; }
  // Voxels without data, which are NaN: cells that touch one have no surface.
  std::uint64_t missingVoxels() const;
  // The same in the values of the input.
  RealRange realRange() const {
    return {spec_.values.real(static_cast<double>(value_range_.min)),
            spec_.values.real(static_cast<double>(value_range_.max))};
  }
  // JSON text: source, filter, tool version, notes.
  const std::string& provenance() const;
  // An isovalue as queries compare it with samples: the nearest float, or where stored numbers are
  // not those of the input the next one that is not below it: with voxels at that float an isovalue
  // that is rounded down would have them on its other side.
  float storedIsovalue(double isovalue) const;
  // The standard deviation of the voxels' noise, in stored numbers, as the build estimated it from
  // second differences along x; 0 if there is none.
  double noise() const;
  // How often which stored numbers occur among the voxels of level 0. Reads and unpacks it, at most
  // VoxelHistogram::kMostBins counts. Throws Error if it is damaged.
  VoxelHistogram histogram() const;
  // Bytes of the file; of a divided pyramid, those of all its files.
  std::uint64_t fileBytes() const;
  // Bricks of all levels.
  std::size_t brickCount() const;
  // The bytes of the file by kind: passes over the whole brick table. Throws Error if any entry is
  // damaged.
  PyramidSums sums() const;
  // The work of the network so far; all zero for a local file.
  RemoteCounters remoteCounters() const;
  // The budget that it was opened with.
  std::uint64_t budgetBytes() const { return budget_bytes_; }

  // Closure of the values in the brick's cells: it takes in every value that a surface in them can
  // be interpolated from, on the brick's level and all finer ones. Reads no brick.
  ValueRange brickRange(int level, const Index3& brick) const;
  // The brick's samples, at least those of layout().brickSampleBox(). Throws Error that names the
  // brick if its bytes are damaged or cannot be read, and Cancelled if that is requested while it
  // waits for a read.
  BrickSamples samples(int level, const Index3& brick, const CancelFlag* cancel = nullptr) const;
  // The closures, as of brickRange(), of the brick's tiles: layout().brickTiles() of them, x
  // fastest. `out` is resized. Throws as samples().
  void tileRanges(int level, const Index3& brick, std::vector<ValueRange>& out,
                  const CancelFlag* cancel = nullptr) const;
  // Throws Error if bytes of this brick could not be read while they were in use (the file was cut,
  // its disk failed): the results computed from them are wrong. Call it after using samples and
  // before passing on the result.
  void throwIfReadsFailed(int level, const Index3& brick) const;

  // For the library itself (storage/pyramid_parts.h, which is not installed).
  const PyramidParts& parts() const { return *parts_; }

 private:
  const std::unique_ptr<const PyramidTables> tables_;
  const std::unique_ptr<const PyramidParts> parts_;
  const std::uint64_t budget_bytes_;
  // Facts of the file that are asked for everywhere.
  const PyramidSpec spec_;
  const BrickLayout layout_;
  const ValueRange value_range_;
};

}  // namespace isobrick
