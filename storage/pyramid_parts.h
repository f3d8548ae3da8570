// The parts of all bricks of an open pyramid: which there are, which are resident, and what is in
// them. The rest of the library reads and pages by this; programs outside read by Pyramid.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "isobrick/storage/brick_pager.h"
#include "isobrick/storage/brick_supply.h"
#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_tables.h"
#include "isobrick/storage/source_bricks.h"

namespace isobrick {

// The closures of the tiles of one brick.
struct BrickRanges {
  BrickPart part;      // pairs of the pyramid's voxel type; no bytes if all voxels are one value
  float constant = 0;  // that value

  // For tile number `tile`, x fastest.
  template <typename T>
  ValueRange tile(std::size_t tile) const {
    if (part.data() == nullptr) return {constant, constant};
    const T* pair = reinterpret_cast<const T*>(part.data()) + 2 * tile;
    return {static_cast<float>(pair[0]), static_cast<float>(pair[1])};
  }
};

// All const members are thread-safe. A member that takes a brick throws Error, which names it, if
// its row of the brick table is damaged. One that reads a part throws Error that names the brick if
// its bytes are damaged or cannot be read, and Cancelled if that is requested while it waits.
class PyramidParts {
 public:
  // `tables` outlive this object. `budget_bytes`: see BrickPager.
  PyramidParts(const PyramidTables& tables, std::uint64_t budget_bytes,
               std::shared_ptr<const BrickSupply> supply = nullptr);
  ~PyramidParts();
  PyramidParts(const PyramidParts&) = delete;

  const PyramidTables& tables() const { return tables_; }
  // True if there is level 0 alone, and it lies elsewhere: nothing of it counts as stored.
  bool isSupplied() const { return supply_ != nullptr; }

  // ---- which parts there are: the brick table

  // Row of the brick in the file's table: a number that identifies it among all levels.
  std::size_t brickRow(int level, const Index3& brick) const { return rows_.row(level, brick); }
  // The brick of a row below brickCount().
  BrickAddress brickAt(std::size_t row) const { return rows_.address(row); }
  std::size_t brickCount() const { return rows_.count(); }
  // The entry of a brick in the brick table.
  BrickRow brickRowOf(int level, const Index3& brick) const {
    return isSupplied() ? BrickRow() : index().row(brickRow(level, brick));
  }
  // False if the row has to be read from the file first: see BrickIndex::isAtHand().
  bool isRowAtHand(int level, const Index3& brick) const {
    return index().isAtHand(brickRow(level, brick));
  }
  // Closure of the values in the brick's cells (rule 7).
  ValueRange brickRange(int level, const Index3& brick) const {
    if (isSupplied()) return tables_.valueRange();  // nobody went through the voxels yet
    const BrickRow row = brickRowOf(level, brick);
    return {row.range_min, row.range_max};
  }
  // Bytes that a part takes in the file, packed or not; 0 if none is stored.
  std::uint64_t storedBytes(PartKind kind, int level, const Index3& brick) const {
    return brickRowOf(level, brick).part(kind).stored_bytes;
  }
  // As BrickIndex's, by brickRow().
  bool isRowAbsent(std::size_t row) const { return index().isAbsent(row); }
  void bringInRows(std::span<const std::size_t> rows) const { index().bringIn(rows); }
  // Bytes of the brick table that were read since it was opened: not among the counters below.
  std::uint64_t tableBytesRead() const { return index().bytesRead(); }

  // ---- what is in them

  // As Pyramid's.
  BrickSamples samples(int level, const Index3& brick, const CancelFlag* cancel = nullptr) const;
  void tileRanges(int level, const Index3& brick, std::vector<ValueRange>& out,
                  const CancelFlag* cancel = nullptr) const;
  // Closures of the brick's tiles, layout().brickTiles() of them, x fastest.
  BrickRanges ranges(int level, const Index3& brick, const CancelFlag* cancel = nullptr) const;
  // For each of these tiles 1 if its range crosses the isovalue (ValueRange::crosses), else 0.
  void crossedTiles(int level, const Index3& brick, float isovalue, std::vector<std::uint8_t>& out,
                    const CancelFlag* cancel = nullptr) const;
  // kDeviationCoefficients codes (DeviationCode) for each of layout().brickCurvatureBlocks(brick)
  // of a brick of level 0, x fastest; over the range of the block's tiles. All are 255, infinity,
  // if the brick has nothing to gain, and `out` is empty if the pyramid has none. It is resized.
  void curvature(const Index3& brick, std::vector<std::uint8_t>& out,
                 const CancelFlag* cancel = nullptr) const;

  // As Pyramid's.
  void throwIfReadsFailed(int level, const Index3& brick) const;
  // True if that may throw for any brick. Costs next to nothing.
  bool hasFailedReads() const { return tables_.bytes().failedOffset().has_value(); }
  // How often the file was found written to: if this number is the same before and after, the parts
  // used in between did not change. Asks the system for the time of the file's last change.
  std::uint64_t edition() const { return pager_.noticeChanges(); }
  // After another edition was found: throws Error if the part of the brick, used in place, is not
  // what it was when the pyramid was opened.
  void throwIfWrittenOver(PartKind kind, int level, const Index3& brick) const;

  // ---- which are resident: paging

  // Another query asks for parts from here on: parts that queries ask for no more are the first to
  // go. Returns the query's number: see BrickPager::reserve().
  std::uint64_t beginQuery() const { return pager_.beginQuery(); }
  // Brings a part in ahead of its use, if one is stored: see BrickPager::fetch().
  BrickPager::Fetched fetch(PartKind kind, int level, const Index3& brick,
                            const CancelFlag* cancel = nullptr,
                            const std::shared_ptr<BrickPager::Room>& room = nullptr) const;
  // Sets aside the room that these parts of a brick need to come in: see BrickPager::reserve().
  std::shared_ptr<BrickPager::Room> reserve(std::span<const PartKind> kinds, int level,
                                            const Index3& brick, std::uint64_t since) const;
  // Has the system, or the server, begin with those of these parts that are stored: see
  // BrickPager::announce(). Parts that are announced together may come in fewer requests.
  struct PartAddress {
    PartKind kind;
    int level;
    Index3 brick;
  };
  void announce(std::span<const PartAddress> parts) const;
  // True if the parts come from a server, which answers many requests in the time of one.
  bool isRemote() const {
    return tables_.bytes().isRemote() || spec().level0 == Level0Place::kBehindUrl;
  }
  // True if no disk and no server has to be waited for to bring the part in: it is not stored, or
  // the system's page cache has it. May be false for a part that is cached.
  bool isCached(PartKind kind, int level, const Index3& brick) const;
  // Makes a part resident, if one is stored. Throws Error that says why it cannot be read, and
  // Cancelled.
  void require(PartKind kind, int level, const Index3& brick,
               const CancelFlag* cancel = nullptr) const;
  // A hold on a part that is resident, which stays so as long as the hold lives; none if it is not.
  // For a part that is not stored the hold is empty.
  std::optional<BrickPart> holdIfResident(PartKind kind, int level, const Index3& brick) const;
  // Takes back what was fetched of the brick, for a query that was cancelled: see
  // BrickPager::withdraw().
  void withdraw(int level, const Index3& brick) const;
  // The bytes of a part that count against the budget while it is resident; 0 if none is stored.
  std::uint64_t heldBytes(PartKind kind, int level, const Index3& brick) const;
  // The bytes of all parts that count against it now.
  std::uint64_t heldBytes() const { return pager_.heldBytes(); }
  // How often a part was asked for that was not resident.
  std::uint64_t missCount() const { return pager_.missCount(); }
  BrickPager::Counters counters() const { return pager_.counters(); }

 private:
  using enum PartKind;
  static std::size_t partId(PartKind kind, std::size_t row) {
    return kPartKinds.size() * row + static_cast<std::size_t>(kind);
  }
  const BrickIndex& index() const { return tables_.index(); }
  const PyramidSpec& spec() const { return tables_.spec(); }
  const BrickLayout& layout() const { return tables_.layout(); }
  BrickPager::Part pagedPart(PartKind kind, int level, const Index3& brick) const;
  BrickPart acquire(PartKind kind, int level, const Index3& brick,
                    const CancelFlag* cancel = nullptr) const;
  BrickPart suppliedRanges(const Index3& brick) const;
  void throwIfReadFailed(PartKind kind, int level, const Index3& brick) const;

  const PyramidTables& tables_;
  const std::shared_ptr<const BrickSupply> supply_;  // null: level 0 is stored
  const TableRows rows_;                             // of all bricks of all levels
  const std::unique_ptr<Level0Source> source_;       // of an index; else null
  mutable BrickPager pager_;                         // thread-safe by itself
};

}  // namespace isobrick
