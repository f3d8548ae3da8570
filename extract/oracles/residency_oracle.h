// The residency oracle: as fine as the resident parts allow.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <vector>

#include "isobrick/extract/oracles/coverage.h"
#include "isobrick/extract/paging/query_needs.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

// A small table of facts that never change: asking takes no lock, so threads do not wait for each
// other. A brick may push out another one, of which nothing is known here then. Any thread asks,
// one at a time notes.
class KnownBricks {
 public:
  // Bits.
  enum Facts : std::uint64_t { kNothing = 0, kUsable = 1, kUnusable = 2, kRefused = 4 };

  // Of a brick, by its row of the brick table.
  std::uint64_t of(std::size_t row) const {
    const std::uint64_t entry = entries_[row % kPlaces].load(std::memory_order_acquire);
    return entry >> kFactBits == row + 1 ? entry & kFactMask : std::uint64_t{kNothing};
  }
  // In place of what was known of it.
  void note(std::size_t row, std::uint64_t facts) {
    entries_[row % kPlaces].store((std::uint64_t{row} + 1) << kFactBits | facts,
                                  std::memory_order_release);
  }

 private:
  static constexpr std::size_t kPlaces = 2048;
  static constexpr int kFactBits = 3;
  static constexpr std::uint64_t kFactMask = (std::uint64_t{1} << kFactBits) - 1;

  std::array<std::atomic<std::uint64_t>, kPlaces> entries_{};  // the row + 1, and the facts below
};

// A brick of which a query would take parts that are not resident.
struct MissingBrick {
  int level = 0;
  Index3 brick{0};
  bool needs_samples = false;  // whatever its ranges say
  bool lacks_parts = false;    // certainly lacks some that QueryNeeds lists
};

// Refines a cell of level l if the brick of level l - 1 that holds its children is usable. That is
// a brick
//
//   - of which all parts are resident that the query takes of it (QueryNeeds),
//   - whose samples are resident too if a coarser leaf beside it may need them and has no other
//     brick to take them from,
//   - and the parents of which, and of its 26 neighbours, are usable.
//
// Levels that are one brick are always usable: they are few bytes, and are read at the start. By
// the last condition the leaves are 2:1 balanced. Let c be a refined cell of level l, and b the
// brick of its children; a cell n of level l that touches c has its children in b or a neighbour of
// b, so the parent of that brick is usable, and the cell of level l + 1 around n is refined. So
// nothing that touches c is coarser than c. It also gives that the parent of a refined cell is
// refined.
//
// The parts of a brick are looked up once, and those found are held as long as this object lives:
// so the answers do not change while bricks come and go, and a brick that was found usable is there
// when it is meshed. All members are thread-safe.
class ResidencyOracle {
 public:
  // `needs`: of the query. Reads the levels that are one brick if they are not resident: before
  // anything is fetched for the query, so that they need not push that out later. Throws Error if
  // they cannot be read, and Cancelled.
  explicit ResidencyOracle(const QueryNeeds& needs, const CancelFlag* cancel = nullptr);

  const QueryNeeds& needs() const { return needs_; }

  bool refines(int level, const Index3& cell);
  // kAll only if all bricks of children are usable.
  Coverage refinedCoverage(int level, const IndexBox& cells);
  // Among the `count` cells from `first` on along x, bit i being first.x + i, keeps those refined.
  void keepRefined(int level, const Index3& first, std::int64_t count, std::uint64_t* bits);

  // Whether the brick is usable.
  bool isUsableNow(int level, const Index3& brick);
  // Whether the brick is unusable because parts of its own are missing. Looks up no further part.
  bool lacksParts(int level, const Index3& brick);
  // Whether the brick's samples are held.
  bool holdsSamples(int level, const Index3& brick);

  // Calls f(parent) for the bricks of level + 1 that hold the brick or one of its neighbours.
  template <typename F>
  void forEachParentAround(int level, const Index3& brick, F&& f) const {
    const Index3 first = glm::max(brick - Index3(1), Index3(0)) / std::int64_t{2};
    const Index3 last =
        glm::min(brick + Index3(1), layout_.bricks(level) - Index3(1)) / std::int64_t{2};
    forEachIndex({first, last - first + Index3(1)}, f);
  }

  // The other oracles refine cells of the box, this one does not: notes the missing bricks.
  void noteRefused(int level, const IndexBox& cells);
  // The results of noteRefused(). Not while another thread uses the oracle.
  const std::vector<MissingBrick>& missing() const { return missing_; }
  bool hasRefused() const { return has_refused_; }

 private:
  enum class Usable : std::uint8_t { kUnknown, kNo, kYes };
  struct Brick {
    std::array<std::optional<BrickPart>, kPartKinds.size()> parts;  // by PartKind
    std::array<bool, kPartKinds.size()> is_asked{};
    bool is_refused = false;
    Usable usable = Usable::kUnknown;
  };

  std::size_t rowOf(int level, const Index3& brick) const {
    return needs_.pyramid().parts().brickRow(level, brick);
  }
  bool isUsableOrFindOut(int level, const Index3& brick);

  // All with the lock.
  bool isUsable(int level, const Index3& brick);
  bool hasOwnParts(int level, const Index3& brick);
  bool lacksBorder(int level, const Index3& brick);
  bool hasRow(int level, const Index3& brick) const;
  bool has(PartKind kind, int level, const Index3& brick);
  // The resident parts, for QueryNeeds.
  auto whatIsThere() {
    return BrickAnswers{
        [this](int level, const Index3& brick) { return hasRow(level, brick); },
        [this](PartKind kind, int level, const Index3& brick) { return has(kind, level, brick); }};
  }
  void refuse(int level, const Index3& brick);
  Brick& at(int level, const Index3& brick) { return bricks_[rowOf(level, brick)]; }
  // For the level below that hold the cells' children.
  IndexBox bricksOfChildren(int level, const IndexBox& cells) const;

  const QueryNeeds needs_;
  const BrickLayout& layout_;
  int first_whole_level_ = 0;                      // from here on levels are one brick
  KnownBricks known_;                              // of those below, without the lock
  std::mutex mutex_;                               // guards all below
  std::unordered_map<std::size_t, Brick> bricks_;  // by row of the brick table
  std::vector<BrickPart> whole_levels_;            // held
  std::vector<MissingBrick> missing_;
  bool has_refused_ = false;
};

}  // namespace isobrick
