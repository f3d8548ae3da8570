// Reading a pyramid: a validated `.isb` file whose bricks come and go.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/storage/brick_pager.h"
#include "isobrick/storage/brick_parts.h"
#include "isobrick/storage/cancel.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/error_bins.h"
#include "isobrick/storage/gradient_spectrum.h"
#include "isobrick/storage/pyramid_info.h"
#include "isobrick/storage/voxel_histogram.h"

namespace isobrick {

class BrickIndex;
class Pyramid;

// The hold on one part of a brick: in the file's map where it is stored, in a buffer where it was
// unpacked or made. The memory that `data()` returns is aligned to 16 bytes at least, and stays
// valid and unchanged as long as this object lives. Movable; used by one thread at a time.
class BrickPart {
 public:
  BrickPart() = default;
  BrickPart(BrickPart&& other) noexcept { swap(other); }
  BrickPart& operator=(BrickPart&& other) noexcept {
    swap(other);
    return *this;
  }
  ~BrickPart() {
    if (pager_ != nullptr) pager_->release(id_);
  }

  const std::byte* data() const { return data_; }

 private:
  friend class Pyramid;
  void swap(BrickPart& other) noexcept {
    std::swap(pager_, other.pager_);
    std::swap(id_, other.id_);
    std::swap(data_, other.data_);
    std::swap(made_, other.made_);
  }

  BrickPager* pager_ = nullptr;  // null where the bytes were made rather than read
  std::size_t id_ = 0;
  const std::byte* data_ = nullptr;
  std::vector<std::byte> made_;
};

// The samples of one brick: `box` in samples of the level, x fastest, of the pyramid's voxel type.
struct BrickSamples {
  IndexBox box;
  BrickPart part;

  template <typename T>
  const T* data() const {
    return reinterpret_cast<const T*>(part.data());
  }
};

// The closures of the tiles of one brick.
struct BrickRanges {
  BrickPart part;      // pairs of the pyramid's voxel type; no bytes where all voxels are one value
  float constant = 0;  // that value

  // Of tile number `tile`, x fastest.
  template <typename T>
  ValueRange tile(std::size_t tile) const {
    if (part.data() == nullptr) return {constant, constant};
    const T* pair = reinterpret_cast<const T*>(part.data()) + 2 * tile;
    return {static_cast<float>(pair[0]), static_cast<float>(pair[1])};
  }
};

// What verify found wrong with one part of one brick.
struct BrickDamage {
  int level = 0;
  Index3 brick{0};
  std::string what;  // does not say which brick
};

// An open pyramid. All const members are thread-safe; bricks may be held by any number of threads.
//
// The file should not be changed while it is open. Where it is cut short all the same, or its disk
// fails, acquiring a brick whose bytes are lost, or throwIfReadsFailed() after its use, throws
// Error, and nothing crashes; other bricks stay what they were. Where it is written to,
// throwIfWrittenOver() says so. A file that another one takes the name of stays as it was.
class Pyramid {
 public:
  static constexpr std::uint64_t kDefaultBudgetBytes = std::uint64_t{1} << 30;

  // A provenance of more bytes is refused: it is text for people, and comes into memory as a whole.
  static constexpr std::uint64_t kMostProvenanceBytes = std::uint64_t{64} << 20;

  // Opens and validates header, level table and provenance: sizes, offsets and checksums. Reads no
  // brick, and of the brick table nothing: a row is checked when it is first asked for, and throws
  // Error then where it is damaged. So opening takes as long for any number of bricks, and
  // what stays of the table is bounded (BrickIndex::kMostBytes).
  // `budget_bytes` bounds what stays of the bricks, mapped and unpacked (see BrickPager).
  // With FileAccess::kRead nothing is mapped: all comes by reads, which suits network file systems,
  // and what was read is not touched by what happens to the file. Results are the same.
  // Throws Error where the file is not a pyramid, was truncated, is damaged or of a newer version.
  explicit Pyramid(const std::string& path, std::uint64_t budget_bytes = kDefaultBudgetBytes,
                   FileAccess access = FileAccess::kMap);
  ~Pyramid();

  const std::string& path() const { return file_.path(); }
  const PyramidSpec& spec() const { return spec_; }
  const BrickLayout& layout() const { return layout_; }
  const Lattice& lattice() const { return layout_.lattice(); }
  // Least and greatest voxel of level 0.
  const ValueRange& valueRange() const { return value_range_; }
  // JSON text: source, filter, tool version, notes.
  const std::string& provenance() const { return provenance_; }
  // The standard deviation of the voxels' noise, in their units, as the build estimated it from
  // second differences along x; 0 where there is none.
  double noise() const { return header_.noise; }
  // How often which values occur among the voxels of level 0. Reads and unpacks it, at most
  // VoxelHistogram::kMostBins counts. Throws Error where it is damaged.
  VoxelHistogram histogram() const;
  // How steep the voxels of level 0 are along the isosurface of every value; nothing in files of
  // earlier programs, and where all voxels are equal. Throws Error where it is damaged.
  std::optional<GradientSpectrum> gradients() const;
  // Bytes of the file.
  std::uint64_t fileBytes() const { return file_.size(); }
  // The parts of all bricks summed up: passes over the whole brick table.
  PyramidSums sums() const;

  // What the brick table says of a brick. All that asks for a brick throws Error, which names it,
  // where its row is damaged.
  BrickRow brickRowOf(int level, const Index3& brick) const;
  // False if the row has to be read from the file first: see BrickIndex::isAtHand().
  bool isRowAtHand(int level, const Index3& brick) const;
  // Closure of the values in the brick's cells (rule 7): every sample of the levels 0 to
  // level + log2(brick_cells) in them. From the brick table.
  ValueRange brickRange(int level, const Index3& brick) const;

  // The brick's samples, at least those of layout().brickSampleBox(). Throws Error that names the
  // brick where its bytes are damaged or cannot be read.
  // This and what follows throws Cancelled where that is requested while it waits for a read.
  BrickSamples samples(int level, const Index3& brick, const CancelFlag* cancel = nullptr) const;
  // Closures of the brick's tiles, layout().brickTiles() of them, x fastest: every sample of the
  // levels 0 to level + log2(tile_cells) in the tile.
  BrickRanges ranges(int level, const Index3& brick, const CancelFlag* cancel = nullptr) const;
  // All of them. `out` is resized.
  void tileRanges(int level, const Index3& brick, std::vector<ValueRange>& out,
                  const CancelFlag* cancel = nullptr) const;
  // For each of these tiles 1 where its range crosses the isovalue (ValueRange::crosses), else 0.
  void crossedTiles(int level, const Index3& brick, float isovalue, std::vector<std::uint8_t>& out,
                    const CancelFlag* cancel = nullptr) const;
  // Three coefficients (CurvatureCode) for each of layout().brickNodes(brick) cells of level 1 in a
  // brick of level 0, x fastest; over the range of the level-0 tile that holds the node's first
  // cell. Empty where the pyramid has none. `out` is resized.
  void curvature(const Index3& brick, std::vector<std::uint8_t>& out,
                 const CancelFlag* cancel = nullptr) const;

  // The bins of the bounds that errorCodes() reads; none where the pyramid was built without.
  const ErrorBins& errorBins() const { return error_bins_; }
  // For every cell of a brick of level 2 or 3, x fastest, the code (ErrorCode, in units of
  // errorBins()) of a bound of its error for an isovalue, or without one for all (rule 15). False,
  // with an empty `out`, where the pyramid has none of this level.
  bool errorCodes(int level, const Index3& brick, std::optional<double> isovalue,
                  std::vector<std::uint8_t>& out, const CancelFlag* cancel = nullptr) const;

  // Bytes that the samples of a brick take in the file, packed or not (0 for a constant brick).
  std::uint64_t sampleBytes(int level, const Index3& brick) const;
  std::uint64_t rangeBytes(int level, const Index3& brick) const;
  std::uint64_t curvatureBytes(const Index3& brick) const;
  std::uint64_t errorBytes(int level, const Index3& brick) const;
  // Row of the brick in the file's table: a number that identifies it among all levels.
  std::size_t brickRow(int level, const Index3& brick) const;
  // The brick of a row below brickCount().
  BrickAddress brickAt(std::size_t row) const;
  std::size_t brickCount() const;

  // Throws Error where bytes of this brick could not be had while somebody used them (the file was
  // cut, its disk failed): what was computed from them is worthless. To be called after samples
  // were used and before the result is passed on.
  void throwIfReadsFailed(int level, const Index3& brick) const;
  // True where that may be so of any brick. Costs next to nothing.
  bool hasFailedReads() const { return file_.failedOffset().has_value(); }

  // How often the file was found written to: where this number is the same before and after, nobody
  // wrote to what was used in between. Asks the system for the time of the file's last change.
  std::uint64_t edition() const { return pager_->noticeChanges(); }
  // After another edition was found: throws Error where the part of the brick, if it is used in
  // place, is not what it was when the pyramid was opened.
  void throwIfWrittenOver(PartKind kind, int level, const Index3& brick) const;

  // Reads every part of one brick and says what is wrong with it: bytes, samples that are not
  // finite, and ranges that are not just what section 6 of docs/FORMAT.md says. For the latter it
  // also reads tile ranges of the next finer level and samples of coarser ones; where it is their
  // fault, or they cannot be read, this brick is not named.
  std::optional<BrickDamage> verifyBrick(int level, const Index3& brick) const;
  // What is wrong outside of the bricks, a line each: reserved fields and padding that are not
  // zero, parts that overlap, a value range that is not that of the voxels. Reads the padding.
  std::vector<std::string> verifyRest(const CancelFlag* cancel = nullptr) const;

  // Says that parts are asked for by another query from here on: what queries do not ask for any
  // more is the first to go. Returns the query's number: see BrickPager::reserve().
  std::uint64_t beginQuery() const { return pager_->beginQuery(); }
  // Brings a part in ahead of its use, where one is stored: see BrickPager::fetch().
  BrickPager::Fetched fetch(PartKind kind, int level, const Index3& brick,
                            const CancelFlag* cancel = nullptr) const;
  // Sets aside the room that these parts of a brick need to come in: see BrickPager::reserve().
  std::optional<BrickPager::Room> reserve(std::span<const PartKind> kinds, int level,
                                          const Index3& brick, std::uint64_t since) const;
  // Brings a part into such room: see BrickPager::fetch().
  BrickPager::Fetched fetch(PartKind kind, int level, const Index3& brick,
                            BrickPager::Room& room) const;
  // Has the system begin to read a part, where one is stored: see BrickPager::announce().
  void announce(PartKind kind, int level, const Index3& brick) const;
  // Makes a part resident, if one is stored. Throws Error that says why it cannot be read, and
  // Cancelled.
  void require(PartKind kind, int level, const Index3& brick,
               const CancelFlag* cancel = nullptr) const;
  // A hold on a part that is resident, for as long as it shall stay that; nothing where it is not.
  // Of a part that is not stored the hold is empty.
  std::optional<BrickPart> holdIfResident(PartKind kind, int level, const Index3& brick) const;
  // Takes back what was fetched of the brick, for a query that was cancelled: see
  // BrickPager::withdraw().
  void withdraw(int level, const Index3& brick) const;
  // What a part of the brick counts against the budget while it is resident; 0 where none is
  // stored.
  std::uint64_t heldBytes(PartKind kind, int level, const Index3& brick) const;
  std::uint64_t budgetBytes() const { return budget_bytes_; }
  // What counts against it now, of all parts.
  std::uint64_t heldBytes() const { return pager_->heldBytes(); }
  // How often a part was asked for that was not resident.
  std::uint64_t missCount() const { return pager_->missCount(); }
  BrickPager::Counters counters() const { return pager_->counters(); }
  // Bytes of the brick table that were read since it was opened: not among the counters above.
  std::uint64_t tableBytesRead() const;

 private:
  using enum PartKind;
  void readHeader();
  void readErrorBins(const format::Header& header);
  void readTables(const format::Header& header);
  [[noreturn]] void failErrorSize(int level, const Index3& brick) const;
  std::vector<std::byte> readTable(std::uint64_t offset, std::uint64_t bytes,
                                   std::uint64_t checksum, const char* name) const;
  static std::size_t partId(PartKind kind, std::size_t row) {
    return kPartKinds.size() * row + static_cast<std::size_t>(kind);
  }
  format::PartEntry entryOf(PartKind kind, int level, const Index3& brick) const;
  BrickPager::Part pagedPart(PartKind kind, int level, const Index3& brick) const;
  BrickPart acquire(PartKind kind, int level, const Index3& brick,
                    const CancelFlag* cancel = nullptr) const;
  void throwIfReadFailed(PartKind kind, int level, const Index3& brick) const;
  [[noreturn]] void fail(const std::string& what, ErrorPlace place = {}) const;
  friend class BrickVerifier;  // storage/pyramid_verify.cpp

  PagedFile file_;
  std::uint64_t budget_bytes_;
  format::Header header_{};
  PyramidSpec spec_;
  BrickLayout layout_;
  ValueRange value_range_;
  ErrorBins error_bins_;
  std::string provenance_;
  std::unique_ptr<BrickIndex> index_;
  std::unique_ptr<BrickPager> pager_;
};

}  // namespace isobrick
