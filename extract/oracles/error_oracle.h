// The error oracle: as coarse as a tolerance in the data's units allows (rule 15).
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <unordered_set>

#include "isobrick/extract/oracles/oracle_share.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/error_bins.h"
#include "isobrick/storage/value_range.h"

namespace isobrick {

class CellBits;
class Pyramid;
struct FoundCells;
struct MeshContext;

// Refines every cell but those of level 1 that stay within the tolerance, and those of the levels 2
// and 3 whose stored bound does, where the pyramid has bounds.
//
// Whether a cell of level 1 stays within it depends on what is refined around: cellsBeyond().
//
// Leaves are balanced whatever the file says: a cell of level 1 or 2 is refined only where all
// cells of the next level that touch it are. Of a true bound that changes nothing, as it is at
// least the error of every finer cell that touches the cell.
//
// What it decides of a brick's cells is found once a query and shared by all threads; the bits of
// the last kMostBricks bricks are kept. For level 1 that takes the samples of a brick of level 0,
// of the one of level 1 over it and of those around, where a cell may be refined; for others their
// bounds. All members are thread-safe.
class ErrorOracle {
 public:
  // The tolerance: in units of the voxels, finite, at least 0.
  ErrorOracle(const Pyramid& pyramid, double tolerance, float isovalue);
  ~ErrorOracle();

  bool refines(const MeshContext& context, int level, const Index3& cell) const;
  Share shareOfRefined(int level) const {
    return level >= 1 && level <= last_level_ ? Share::kSome : Share::kAll;
  }
  // Of the `count` cells from `first` on along x, bit i being first.x + i, keeps those refined.
  void keepRefined(const MeshContext& context, int level, const Index3& first, std::int64_t count,
                   std::uint64_t* bits) const;

 private:
  using Bits = std::shared_ptr<const CellBits>;
  using Found = std::shared_ptr<const FoundCells>;
  static constexpr std::size_t kMostBricks = 2048;

  // Made once, by whoever asks first, while others that ask wait; the oldest go. Where making
  // fails, who waited makes it. Shelves are asked while others' bits are made in one order
  // (decided_[1], found_, decided_[2], decided_[3]), so that nobody waits for himself.
  template <typename Value>
  class Shelf {
   public:
    template <typename Make>
    std::shared_ptr<const Value> get(std::size_t row, const Make& make);
    // Whether get() would wait for another thread, at this moment.
    bool isInMaking(std::size_t row) const;

   private:
    mutable std::mutex mutex_;
    std::condition_variable made_;
    std::unordered_map<std::size_t, std::shared_ptr<const Value>> values_;
    std::unordered_set<std::size_t> in_making_;
    std::deque<std::size_t> order_;
  };

  class NearCells;

  // Bricks of level 0 stand for the cells of level 1 in them.
  int brickLevel(int level) const { return level == 1 ? 0 : level; }
  Index3 brickOf(const MeshContext& context, int level, const Index3& cell) const;
  IndexBox cellsOf(const MeshContext& context, int level, const Index3& brick) const;

  // Which of the brick's cells of a level are refined.
  Bits decided(const MeshContext& context, int level, const Index3& brick) const;
  // What the brick of level 0 itself says of its cells of level 1 and of a ring around them.
  Found foundIn(const MeshContext& context, const Index3& brick) const;
  // The errors alone: found for level 1 in the brick and those around, and stored.
  CellBits beyondAtLevel1(const MeshContext& context, const Index3& brick) const;
  CellBits beyondBounds(const MeshContext& context, int level, const Index3& brick) const;
  bool mayRefineBelow(const MeshContext& context, const IndexBox& cells) const;
  // Keeps the cells that only refined cells of level + 1 touch.
  void keepBalanced(const MeshContext& context, int level, CellBits& cells) const;

  const float tolerance_, isovalue_;
  const int last_level_;     // whose cells may be leaves
  const int greatest_code_;  // that is within the tolerance
  mutable Shelf<FoundCells> found_;
  mutable Shelf<CellBits> decided_[kMostErrorLevel + 1];
};

}  // namespace isobrick
