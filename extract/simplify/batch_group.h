// Simplified bricks that are simplified again together, so that what was fixed between them goes.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <unordered_map>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/simplify/simplify_remains.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Bricks of level 0 in a cube, as one batch.
class BatchGroup {
 public:
  // Cells along each axis of a cube: positions in it are as exact as those in the largest brick.
  static constexpr std::int64_t kCells = 256;

  // `cube`: its place among the cubes.
  explicit BatchGroup(const Index3& cube);
  // A batch of a brick in the cube, with its remains.
  void add(const PlacedBatch& brick);
  // After the last one: vertices that no other batch has are not shared any more.
  void close();
  std::size_t triangles() const { return (placed.batch.triangles.size() + caps_.size()) / 3; }
  // Bytes that it takes in memory, about.
  std::uint64_t bytes() const;

  PlacedBatch placed;
  SimplifyRemains remains;
  std::vector<std::uint8_t> is_seam;  // of vertices, after close(): 1 if it was shared

 private:
  struct Shared {
    std::uint32_t vertex = 0;
    std::uint32_t batches = 0;  // SharedVertex::batches
    std::uint32_t seen = 0;     // batches that had it
  };
  std::unordered_map<EdgeKey, Shared> shared_;
  // Of caps, which come behind all other triangles.
  RawVector<std::uint32_t> caps_;
  RawVector<Deviation> cap_deviations_;
};

// True if a query simplifies groups, while it is meshed or later.
bool simplifiesGroups(const Query& query);

// Puts bricks into groups. These and their order depend on the bricks alone, which come in the
// order of the brick table. Groups that are not whole hold kMostOpenBytes at the most.
class GroupSorter {
 public:
  static constexpr std::uint64_t kMostOpenBytes = std::uint64_t{64} << 20;
  // A group of so many triangles is closed before its cube is full.
  static constexpr std::size_t kMostTriangles = std::size_t{1} << 17;
  using Groups = std::vector<std::unique_ptr<BatchGroup>>;

  // `brick_cells`: along each axis of a brick.
  explicit GroupSorter(std::int64_t brick_cells)
      : bricks_(std::max<std::int64_t>(1, BatchGroup::kCells / brick_cells)) {}

  // The groups that are whole with it, in order.
  Groups add(const PlacedBatch& brick);
  // All others.
  Groups takeRest();

 private:
  // z, y and x of a cube's last brick: ascending in the order of the brick table.
  using Place = std::array<std::int64_t, 3>;
  using OpenGroups = std::map<Place, std::unique_ptr<BatchGroup>>;
  void close(OpenGroups::iterator group, Groups& closed);

  const std::int64_t bricks_;  // along each axis of a cube
  OpenGroups open_;
  std::uint64_t open_bytes_ = 0;
};

}  // namespace isobrick
