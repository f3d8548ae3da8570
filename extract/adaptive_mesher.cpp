#include "isobrick/extract/adaptive_mesher.h"

#include <bit>

#include "isobrick/extract/meshing/brick_vertices.h"
#include "isobrick/extract/meshing/fans.h"
#include "isobrick/extract/meshing/leaf_edges.h"
#include "isobrick/extract/meshing/transition_face.h"
#include "isobrick/extract/missing_vertex.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

// One brick; T is the voxel type. Cells and samples without a level are those of `level_`.
template <typename T>
class AdaptiveMesher::Brick {
 public:
  Brick(AdaptiveMesher& memory, const MeshContext& context, const BrickWork& work, MeshBatch& batch)
      : context_(context),
        work_(work),
        batch_(batch),
        lattice_(context.lattice()),
        level_(work.level),
        cells_(context.pyramid.layout().brickCellBox(level_, work.brick)),
        tiles_(memory.tiles_),
        leaves_(memory.leaves_),
        corners_(memory.corners_),
        classifier_(context),
        family_(context, level_, work.brick),
        vertices_(context, family_, memory.numbers_, batch) {}

  void run() {
    const Index3 edge(context_.pyramid.layout().tileCells());
    forEachIndex({Index3(0), tiles_.dims()}, [&](const Index3& tile) {
      if (!tiles_.isActive(tile)) return;
      const Index3 first = cells_.first + tile * edge;
      meshTile({first, glm::min(edge, cells_.end() - first)});
    });
  }

 private:
  void meshTile(const IndexBox& cells) {
    if (!overlapsQueryBox(context_, level_, cells)) return;
    if (!findLeaves(classifier_, level_, cells, leaves_)) return;
    resolveCorners(lattice_, leaves_, family_, corners_);
    forEachIndex(cells, [&](const Index3& cell) {
      if (leaves_.state(cell) == CellState::kLeaf &&
          overlapsQueryBox(context_, level_, {cell, Index3(1)}))
        meshLeaf(cell);
    });
  }

  void meshLeaf(const Index3& cell) {
    const unsigned pattern = signPattern(cell);
    if (pattern == 0 || pattern == 255) return;
    ++batch_.cells;
    const MarchingCubesCase& mc = marchingCubesTable()[pattern];
    const CellVertices vertices = edgeVertices(cell, mc);
    const unsigned finer = facesBesideFiner(cell);
    if (finer == 0)
      addPlainTriangles(context_.frame, mc, vertices, batch_);
    else
      meshTransitionLeaf(cell, pattern, finer, vertices);
  }

  unsigned signPattern(const Index3& cell) const {
    unsigned pattern = 0;
    for (unsigned c = 0; c < 8; ++c)
      if (corners_.at(cell + Index3(c & 1, c >> 1 & 1, c >> 2)).value >= context_.isovalue)
        pattern |= 1u << c;
    return pattern;
  }

  CellVertices edgeVertices(const Index3& cell, const MarchingCubesCase& mc) {
    CellVertices vertices;
    vertices.fill(kNoVertex);
    for (std::uint32_t rest = mc.crossed_edges; rest != 0; rest &= rest - 1) {
      const auto e = static_cast<std::size_t>(std::countr_zero(rest));
      const CellEdge& edge = kCellEdgeTable[e];
      vertices[e] = leafEdgeVertex(cell + Index3(edge.x, edge.y, edge.z), edge.axis);
    }
    return vertices;
  }

  std::uint32_t leafEdgeVertex(const Index3& base, int axis) {
    const LeafEdge edge = leafEdge(lattice_, leaves_, cells_, base, axis);
    if (!edge.is_of_coarser)
      return vertices_.vertexOn(axis, corners_.at(edge.low), corners_.at(edge.high),
                                edge.is_shared);
    const auto ownPoint = [&](const Index3& sample) {
      return LatticePoint{family_.own().value(sample), level_, sample};
    };
    return vertices_.vertexOn(axis, ownPoint(edge.low), ownPoint(edge.high), edge.is_shared);
  }

  // Bit f: the neighbour across face f is refined.
  unsigned facesBesideFiner(const Index3& cell) const {
    if (leaves_.all_leaves) return 0;
    unsigned faces = 0;
    for (int face = 0; face < 6; ++face) {
      Index3 neighbour = cell;
      neighbour[face / 2] += face % 2 == 0 ? -1 : 1;
      if (leaves_.state(neighbour) == CellState::kFiner) faces |= 1u << face;
    }
    return faces;
  }

  // Rule 10: the contour follows the fine side's polyline on every transition face, and every loop
  // becomes a fan.
  void meshTransitionLeaf(const Index3& cell, unsigned pattern, unsigned finer,
                          const CellVertices& vertices) {
    ++batch_.transition_cells;
    const auto vertexInFace = [&](int axis, const LatticePoint& low, const LatticePoint& high) {
      return vertices_.vertexOn(axis, low, high, true);
    };
    Contour contour;
    for (int face = 0; face < 6; ++face) {
      if ((finer >> face & 1) == 0)
        addPlainFace(pattern, face, vertices, contour);
      else
        addTransitionFace(makeTransitionFace(lattice_, level_, cell, face, corners_),
                          context_.isovalue, vertices, vertexInFace, contour);
    }
    const glm::dvec3 low(lattice_.position(level_, cell));
    const glm::dvec3 high(lattice_.position(level_, cell + Index3(1)));
    const glm::dvec3 center = context_.frame.position(0.5 * (low + high));
    const bool is_closed = forEachLoop(contour, [&](std::span<const std::uint32_t> loop) {
      addFan(context_.frame, center, loop, batch_);
    });
    if (!is_closed) failMissingVertex(context_, work_);
  }

  const MeshContext& context_;
  const BrickWork& work_;
  MeshBatch& batch_;
  const Lattice& lattice_;
  const int level_;
  const IndexBox cells_;
  const ActiveTiles& tiles_;
  TileLeaves& leaves_;    // of the tile at hand
  TileCorners& corners_;  // of the tile at hand
  LeafClassifier classifier_;
  BrickFamily<T> family_;
  BrickVertices<T> vertices_;
};

void AdaptiveMesher::mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch) {
  numbers_.clear();
  if (!tiles_.load(context, work.level, work.brick)) return;
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    Brick<typename decltype(tag)::Type>(*this, context, work, batch).run();
  });
}

}  // namespace isobrick
