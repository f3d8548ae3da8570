// The vertices on edges of the transition zone, where leaves of several levels meet (rule 8).
#pragma once

#include <algorithm>
#include <cstdint>

#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/kernels/edge_crossings.h"
#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/corner_values.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Writes vertices of one brick that the kernels of uniform bricks cannot make, into a batch whose
// origin is set. They wait in a queue: positions and normals are there after flush(). T: the voxel
// type.
template <typename T>
class TransitionEdges {
 public:
  TransitionEdges(const MeshContext& context, BrickFamily<T>& family, EdgeQueue& queue,
                  MeshBatch& batch)
      : context_(context), family_(family), queue_(queue), batch_(batch) {
    queue_.count = 0;  // a brick that failed may have left some
  }

  // Puts the crossing of the edge of `level` along `axis` from sample `low` to sample `high` in the
  // place of vertex `vertex`. `is_shared`: lists it as one that other bricks may have too. The
  // caller fills low() and high().
  void put(std::uint32_t vertex, int axis, int level, const Index3& low, const Index3& high,
           bool is_shared) {
    if (queue_.count == EdgeQueue::kMost) flush();
    const Lattice& lattice = context_.lattice();
    constexpr CrossingBounds kBounds;
    queue_.least[queue_.count] = kBounds.least;
    queue_.most[queue_.count] = kBounds.most;
    CrossedEdge& edge = queue_.edges[queue_.count++];
    edge.vertex = vertex;
    edge.axis = axis;
    const Index3 base = lattice.position(level, low);
    const Index3& origin = batch_.origin;
    for (int a = 0; a < 3; ++a) (&edge.begin.x)[a] = static_cast<float>(base[a] - origin[a]);
    edge.end = static_cast<float>(lattice.position(level, axis, high[axis]) - origin[axis]);
    if (is_shared) batch_.shared.push_back({vertex, 0, makeEdgeKey(base, axis)});
  }
  // The same for half of a coarser leaf's edge, which begins at sample `half` of `level`: it has
  // the crossing of that whole edge, between the level's own samples, and within its half (rule 8).
  void putHalf(std::uint32_t vertex, int axis, int level, const Index3& half, bool is_shared) {
    Index3 low = half;
    low[axis] = half[axis] / 2 * 2;
    Index3 high = half;
    high[axis] = std::min(low[axis] + 2, context_.lattice().samples(level)[axis] - 1);
    put(vertex, axis, level, low, high, is_shared);
    const SampleView<T>& own = family_.own();
    own.end(low, this->low());
    own.end(high, this->high());
    keepBeside(level, axis, low[axis] + 1);
  }
  EdgeEnd& low() { return queue_.low[queue_.count - 1]; }
  EdgeEnd& high() { return queue_.high[queue_.count - 1]; }

  // The same behind the vertices that there are, of an edge between points of a transition face;
  // returns its number.
  std::uint32_t append(int axis, const LatticePoint& low, const LatticePoint& high) {
    const auto vertex = static_cast<std::uint32_t>(batch_.positions.size());
    batch_.positions.emplace_back();
    batch_.normals.emplace_back();
    put(vertex, axis, low.level, low.sample, high.sample, true);
    takeEnd(low, this->low());
    takeEnd(high, this->high());
    return vertex;
  }

  // Finer leaves touch the edge, whose middle is sample `middle` of `level` along `axis`: keeps the
  // crossing on its side of the value that hangs there. Both ends are filled.
  void keepBeside(int level, int axis, std::int64_t middle) {
    const Lattice& lattice = context_.lattice();
    if (isOnCoarserLattice(lattice, level, axis, middle)) return;  // too short to have one
    const double weight = hangingWeight(lattice, level, axis, middle);
    const auto value = static_cast<float>(
        hangingValue(static_cast<double>(low().value), static_cast<double>(high().value), weight));
    const bool is_above = (value >= context_.isovalue) == (low().value >= context_.isovalue);
    const CrossingBounds bounds = boundsBeside(weight, is_above);
    queue_.least[queue_.count - 1] = bounds.least;
    queue_.most[queue_.count - 1] = bounds.most;
  }

  void flush() {
    queue_.make(context_.frame, context_.isovalue, batch_.positions.data(), batch_.normals.data());
  }

 private:
  void takeEnd(const LatticePoint& point, EdgeEnd& out) {
    family_.at(point.level, point.sample).end(point.sample, out);
    out.value = point.value;
  }

  const MeshContext& context_;
  BrickFamily<T>& family_;
  EdgeQueue& queue_;
  MeshBatch& batch_;
};

}  // namespace isobrick
