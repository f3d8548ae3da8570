// What every worker of one extraction reads.
#pragma once

#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/oracles/query_oracles.h"
#include "isobrick/extract/paging/read_log.h"
#include "isobrick/extract/query.h"
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

  const Lattice& lattice() const { return pyramid.lattice(); }

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
  // Which tiles of the brick the isosurface may cross.
  void crossedTiles(int level, const Index3& brick, std::vector<std::uint8_t>& out) const {
    read_log.note(pyramid.parts().brickRow(level, brick), ReadLog::kRanges);
    pyramid.parts().crossedTiles(level, brick, isovalue, out, query.cancel);
  }

  bool isCancelled() const { return query.cancel != nullptr && query.cancel->requested(); }
  // Throws Cancelled where that is requested.
  void checkCancel() const {
    if (query.cancel != nullptr) query.cancel->check();
  }
  // The brick `number` of `count` is meshed. They are begun in order, and done in nearly the same.
  void noteDone(std::size_t number, std::size_t count) const {
    if (query.fraction_done == nullptr) return;
    const float done = static_cast<float>(number + 1) / static_cast<float>(count);
    float told = query.fraction_done->load(std::memory_order_relaxed);
    while (told < done && !query.fraction_done->compare_exchange_weak(told, done)) {
    }
  }
  // Throws Error where bytes that this thread has asked for could not be had while it used them. To
  // be called before what was made of them is passed on, or another reason is given for it.
  void throwIfReadsFailed() const {
    if (!pyramid.parts().hasFailedReads()) return;
    read_log.forEachNewOfThisThread([this](std::size_t row) {
      const BrickAddress at = pyramid.parts().brickAt(row);
      pyramid.throwIfReadsFailed(at.level, at.brick);
    });
  }
  // Throws Error where somebody wrote to the file since the query began: one that names a brick of
  // the query that is not what it was, if there is one; otherwise it may have been. To be called
  // when no thread is at work on the query any more, before its result is believed. Costs one call
  // to the system.
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

// True where the open extent of a leaf and the query's box overlap, or there is no box.
inline bool overlapsQueryBox(const MeshContext& context, int level, const IndexBox& cells) {
  if (!context.query.box) return true;
  const Index3 low = context.lattice().position(level, cells.first);
  const Index3 high = context.lattice().position(level, cells.end());
  for (int axis = 0; axis < 3; ++axis)
    if (static_cast<double>(low[axis]) >= context.query.box->max[axis] ||
        static_cast<double>(high[axis]) <= context.query.box->min[axis])
      return false;
  return true;
}

}  // namespace isobrick
