// The inputs that all workers of one extraction share.
#pragma once

#include <glm/common.hpp>

#include "isobrick/extract/cap_border.h"
#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/oracles/query_oracles.h"
#include "isobrick/extract/paging/read_log.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/region/region_field.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

class ResidencyOracle;

struct MeshContext {
  const Pyramid& pyramid;
  const Query& query;
  const std::vector<ChoiceOracles>& oracles;  // of the query
  const WorldFrame& frame;
  float isovalue;
  ReadLog& read_log;
  std::uint64_t edition = 0;             // of the pyramid's file when the query began
  ResidencyOracle* residency = nullptr;  // of a progressive query
  const RegionField* region = nullptr;   // of the query, if it has one
  const CapBorder border = CapBorder(pyramid.lattice(), query);

  const Lattice& lattice() const { return pyramid.lattice(); }

  // False if neither the isosurface nor a cap reaches the brick (rule 7).
  bool mayCross(int level, const Index3& brick) const {
    return !query.cull_by_ranges || border.reachesBrick(pyramid, level, brick, isovalue);
  }

  // The bricks of the next finer level that cover the same cells.
  IndexBox finerBricks(int level, const Index3& brick) const {
    const Index3 first = std::int64_t{2} * brick;
    return {first, glm::min(first + Index3(2), pyramid.layout().bricks(level - 1)) - first};
  }

  BrickSamples samples(int level, const Index3& brick) const {
    read_log.note(pyramid.parts().brickRow(level, brick), ReadLog::kSamples);
    return pyramid.samples(level, brick, query.cancel);
  }
  BrickRanges ranges(int level, const Index3& brick) const {
    read_log.note(pyramid.parts().brickRow(level, brick), ReadLog::kRanges);
    return pyramid.parts().ranges(level, brick, query.cancel);
  }
  void tileRanges(int level, const Index3& brick, std::vector<ValueRange>& out) const {
    read_log.note(pyramid.parts().brickRow(level, brick), ReadLog::kRanges);
    pyramid.tileRanges(level, brick, out, query.cancel);
  }
  // The tiles of the brick that the isosurface may cross, or a cap may lie in.
  void crossedTiles(int level, const Index3& brick, std::vector<std::uint8_t>& out) const {
    read_log.note(pyramid.parts().brickRow(level, brick), ReadLog::kRanges);
    border.findTiles(pyramid, level, brick, isovalue, out, query.cancel);
  }

  bool isCancelled() const { return query.cancel != nullptr && query.cancel->requested(); }
  // Throws Cancelled if a stop is requested.
  void checkCancel() const {
    if (query.cancel != nullptr) query.cancel->check();
  }
  // So much of all bricks is meshed, 0 .. 1.
  void noteDone(double share) const {
    if (query.fraction_done == nullptr) return;
    const auto done = static_cast<float>(share);
    float told = query.fraction_done->load(std::memory_order_relaxed);
    while (told < done && !query.fraction_done->compare_exchange_weak(told, done)) {
    }
  }
  // Throws Error if bytes that this thread requested could not be read while it used them. Call it
  // before results made from them are passed on, or another error is reported for them.
  void throwIfReadsFailed() const {
    if (!pyramid.parts().hasFailedReads()) return;
    read_log.forEachNewOfThisThread([this](std::size_t row) {
      const BrickAddress at = pyramid.parts().brickAt(row);
      pyramid.throwIfReadsFailed(at.level, at.brick);
    });
  }
  // Throws the Error for a brick whose samples or ranges do not fit together, so that it lacks a
  // vertex; if their bytes could not be read, the Error of the read.
  [[noreturn]] void failMissingVertex(const BrickWork& work) const {
    throwIfReadsFailed();
    throw Error("'" + pyramid.path() + "' contradicts itself in " +
                    brickName(work.level, work.brick) +
                    ": its samples and value ranges do not fit together; check it with 'isobrick "
                    "verify' and build it again",
                {.path = pyramid.path(), .level = work.level, .brick = work.brick});
  }
  // Throws Error if the file was written to since the query began. The Error names a brick of the
  // query that has changed, if there is one; otherwise it says that one may have changed. Call it
  // when no thread works on the query any more, before its result is used. Costs one system call.
  void throwIfWrittenOver() const {
    if (pyramid.parts().edition() == edition) return;
    for (const ReadLog::Entry& entry : read_log.entries()) {
      const BrickAddress at = pyramid.parts().brickAt(entry.brick_row);
      for (const PartKind kind : kPartKinds)
        if ((entry.marks & ReadLog::markOf(kind)) != 0)
          pyramid.parts().throwIfWrittenOver(kind, at.level, at.brick);
    }
    throw Error("'" + pyramid.path() +
                    "' was written to while it was read, and is what it was; do it again",
                {.path = pyramid.path()});
  }
};

// True if the open extent of a leaf and the query's box overlap, or there is no box; of cells that
// lie more than a voxel outside of the query's region false, too: nothing of them stays.
inline bool overlapsQueryBox(const MeshContext& context, int level, const IndexBox& cells) {
  if (!context.query.box && context.region == nullptr) return true;
  const Index3 low = context.lattice().position(level, cells.first);
  const Index3 high = context.lattice().position(level, cells.end());
  if (context.region != nullptr &&
      context.region->sideOf(low - Index3(1), high + Index3(1)) == BoxSide::kOutside)
    return false;
  if (!context.query.box) return true;
  for (int axis = 0; axis < 3; ++axis)
    if (static_cast<double>(low[axis]) >= context.query.box->max[axis] ||
        static_cast<double>(high[axis]) <= context.query.box->min[axis])
      return false;
  return true;
}

}  // namespace isobrick
