// What every worker of one extraction reads.
#pragma once

#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/oracles/focus_oracle.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/read_log.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

struct MeshContext {
  const Pyramid& pyramid;
  const Query& query;
  const FocusOracle& focus;
  const WorldFrame& frame;
  float isovalue;
  ReadLog& read_log;

  const Lattice& lattice() const { return pyramid.lattice(); }

  BrickSamples samples(int level, const Index3& brick) const {
    read_log.note(pyramid.brickRow(level, brick), ReadLog::kSamples);
    return pyramid.samples(level, brick);
  }
  void tileRanges(int level, const Index3& brick, std::vector<ValueRange>& out) const {
    read_log.note(pyramid.brickRow(level, brick), ReadLog::kRanges);
    pyramid.tileRanges(level, brick, out);
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
