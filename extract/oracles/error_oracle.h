// The error oracle: as coarse as a tolerance in the data's units allows (rule 15).
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <unordered_map>

#include "isobrick/extract/oracles/oracle_share.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/value_range.h"

namespace isobrick {

class CellBits;
struct MeshContext;

// Refines every cell but those of level 1 whose error (ErrorCells) is within the tolerance. So its
// leaves are of the levels 0 and 1, and balanced.
//
// What it decides of a brick's cells, which takes the samples of the brick, of the one of level 1
// over it and of those around, is found once a query and shared by all threads; the bits of the
// last kMostBricks bricks are kept. All members are thread-safe.
class ErrorOracle {
 public:
  // `values`: of all voxels. The tolerance: in their units, finite, at least 0.
  ErrorOracle(double tolerance, float isovalue, const ValueRange& values);
  ~ErrorOracle();

  bool refines(const MeshContext& context, int level, const Index3& cell) const;
  Share shareOfRefined(int level) const { return level == 1 ? Share::kSome : Share::kAll; }
  // Of the `count` cells from `first` on along x, bit i being first.x + i, keeps those refined.
  void keepRefined(const MeshContext& context, int level, const Index3& first, std::int64_t count,
                   std::uint64_t* bits) const;

 private:
  using Bits = std::shared_ptr<const CellBits>;
  static constexpr std::size_t kMostBricks = 2048;

  // Found once by whoever asks first, in the order in which they come; the oldest go.
  class Shelf {
   public:
    template <typename Make>
    Bits get(std::size_t row, const Make& make);

   private:
    std::mutex mutex_;
    std::unordered_map<std::size_t, Bits> bits_;
    std::deque<std::size_t> order_;
  };

  // What the brick itself says of its cells and of a ring around them.
  Bits foundIn(const MeshContext& context, const Index3& brick) const;
  // The brick's cells, joined with what the bricks around say of them.
  Bits decided(const MeshContext& context, const Index3& brick) const;

  const float tolerance_, isovalue_;
  mutable Shelf found_, decided_;
};

}  // namespace isobrick
