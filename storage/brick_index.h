// The brick table of an open pyramid, read and checked row by row as rows are needed.
#pragma once

#include <atomic>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/paged_file.h"
#include "isobrick/storage/pyramid_division.h"

namespace isobrick {

// Advice about damaged bytes.
inline constexpr char kDamageAdvice[] = "build it again or restore a copy";
inline constexpr char kDividedDamageAdvice[] =
    "restore a copy of that file, or delete it, build its super-brick again and join";

// Bricks are numbered as their rows are: all of level 0 (x fastest), then all of level 1, and so
// on. The cost of a query, in time and memory, depends on the rows that it needs and not on how
// many there are: some of the table stays in memory, at most kMostBytes of it. All const members
// are thread-safe.
class BrickIndex {
 public:
  static constexpr std::size_t kRowsAtATime = 32;
  static constexpr std::size_t kMostSlots = 2048;
  static constexpr std::uint64_t kMostBytes =
      kMostSlots * kRowsAtATime * format::rowBytes(format::kMostKinds);

  // A table of at most so many bytes (1024^3 voxels in bricks of 64 cells have half of it) is read
  // when it is opened: in one go, and a file that is cut later loses no row. It is checked row by
  // row all the same.
  static constexpr std::uint64_t kReadAtOnceBytes = std::uint64_t{1} << 20;

  // For a longer table reads nothing. `header` was checked, but for the place of the table. `file`
  // outlives the index. Throws Error if header and layout contradict each other, or the table is
  // not in the file or cannot be read. `own` are the bricks of the file's own table; with
  // `division`, which outlives the index, or is null, those of the other files are there too.
  BrickIndex(const PagedFile& file, const PyramidSpec& spec, const format::Header& header,
             const TableRows& own, const PyramidDivision* division);

  // The ranges that the constructor reads of a table. Their places and their number were not
  // checked.
  static std::vector<ByteRange> rangesReadAtOnce(const format::Header& header);

  std::size_t count() const { return rows_.count(); }
  std::size_t firstOfLevel(int level) const { return rows_.firstOfLevel(level); }
  std::size_t number(int level, const Index3& brick) const { return rows_.row(level, brick); }
  BrickAddress address(std::size_t number) const { return rows_.address(number); }

  // The row of a brick, number < count(). Throws Error, which names the brick, if the row cannot be
  // read, is damaged, or has impossible values.
  BrickRow row(std::size_t number) const;

  // False if row() has to read it first and no other piece of the table has to go for that. Once
  // read it stays in memory: then true for good. True, too, of rows that share a place with others
  // in a table of more than kMostSlots * kRowsAtATime rows, and may have to be read.
  bool isAtHand(std::size_t number) const;

  // Asks a server for the pieces of the table that hold these rows, those that are here apart, and
  // reads them all. For a table that is read row by row; costs a round trip, or none. Damaged rows
  // are left to row().
  void bringIn(std::span<const std::size_t> numbers) const;
  // True if row() has to read it first.
  bool isAbsent(std::size_t number) const;

  // The file whose table has the row: the number of a super-brick, or kOwn.
  static constexpr std::size_t kOwn = ~std::size_t{0};
  std::size_t fileOf(std::size_t number) const { return placeOf(number).file; }

  // Bytes of the table so far.
  std::uint64_t bytesRead() const { return bytes_read_; }

  // The row as it lies in the file, the parts of unknown kinds with it. Throws as row() does.
  struct StoredRow {
    std::vector<format::PartEntry> parts;  // in the order of the header's kinds
    format::RowTail tail{};
  };
  StoredRow storedRow(std::size_t number) const;

 private:
  static constexpr std::size_t kNoPiece = ~std::size_t{0};
  // Some neighbouring rows as bytes, with a bit for each that was checked.
  struct Slot {
    std::mutex mutex;
    std::size_t piece = kNoPiece;
    std::atomic<bool> is_filled = false;  // once, and then for good
    std::vector<std::byte> bytes;
    std::vector<RangeCorrection> corrections;  // of these rows
    std::uint32_t checked = 0;
    static_assert(kRowsAtATime == 32);
  };

  // The place of a brick's row: a file, and the number in its table.
  struct Place {
    std::size_t file = kOwn, row = 0;
  };
  Place placeOf(std::size_t number) const;
  std::size_t numberOf(const Place& place) const;
  Place firstOf(std::size_t piece) const;
  std::size_t pieceOf(const Place& place) const;
  std::size_t rowsIn(std::size_t file) const;
  std::uint64_t base(std::size_t file) const;  // of its offsets
  std::uint64_t offsetOf(const Place& place) const;

  // Calls f with the bytes of a row that was checked, and its slot.
  template <typename F>
  void withRow(std::size_t number, F&& f) const;
  ByteRange rangeOf(std::size_t piece) const;
  void load(Slot& slot, std::size_t piece) const;
  using Corrections = std::shared_ptr<const std::vector<RangeCorrection>>;
  Corrections correctionsOf(std::size_t file) const;
  Corrections knownCorrections(std::size_t file) const;
  // From a row as its file has it to one of the divided pyramid: offsets and range.
  void widen(std::size_t number, const Place& place, const Slot& slot, format::RowTail& tail) const;
  void moveParts(const Place& place, std::span<format::PartEntry> parts) const;
  BrickRow decode(const std::byte* bytes) const;
  void check(std::size_t number, const std::byte* bytes) const;
  [[noreturn]] void fail(std::size_t number, const char* what) const;

  const PagedFile& file_;
  const PyramidSpec spec_;
  const BrickLayout layout_;
  std::uint64_t offset_;
  std::uint64_t row_bytes_;
  std::vector<std::uint32_t> kinds_;
  const PyramidDivision* division_;
  const TableRows own_;   // of the own table
  const TableRows rows_;  // of all
  std::vector<std::size_t>
      first_pieces_;  // of each file of a super-brick; those of the own come first
  std::size_t piece_count_ = 0;
  std::size_t slot_count_ = 0;
  std::unique_ptr<Slot[]> slots_;  // each piece of the table has one possible place
  mutable std::atomic<std::uint64_t> bytes_read_{0};
  mutable std::mutex corrections_mutex_;  // guards those below: of some files, the last used first
  mutable std::list<std::pair<std::size_t, Corrections>> corrections_;
};

}  // namespace isobrick
