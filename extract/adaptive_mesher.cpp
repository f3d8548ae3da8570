#include "isobrick/extract/adaptive_mesher.h"

#include <algorithm>
#include <bit>

#include "isobrick/extract/meshing/brick_vertices.h"
#include "isobrick/extract/meshing/fans.h"
#include "isobrick/extract/meshing/leaf_edges.h"
#include "isobrick/extract/meshing/transition_face.h"
#include "isobrick/extract/missing_vertex.h"
#include "isobrick/extract/row_bits.h"
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
        memory_(memory),
        split_(memory.split_),
        leaves_(memory.split_.leaves()),
        classifier_(context),
        family_(context, level_, work.brick),
        vertices_(context, family_, memory.numbers_, batch) {}

  void run() {
    PlainCells& plain = memory_.plain_;
    plain.reset(cells_);
    split_.split(context_, classifier_, memory_.tiles_, level_, cells_, plain.rows());
    if (!split_.hasPlain() && split_.seamRows().empty()) return;
    memory_.corners_.reset(lattice_, split_, cells_, plain.rows());
    if (!plain.template mesh<T>(context_, work_, family_.ownSamples(), batch_)) return;
    memory_.seam_cells_.clear();
    for (const BrickSplit::SeamRow& row : split_.seamRows()) findSeamCells(row.j, row.k);
    meshSeamCells();
  }

 private:
  // The seam's cells in one row that the isosurface crosses.
  void findSeamCells(std::int64_t j, std::int64_t k) {
    const std::uint64_t* seam = split_.seam(j, k);
    const std::uint64_t* corners[4];
    for (int n = 0; n < 4; ++n)
      corners[n] = memory_.corners_.inside(lattice_, context_.isovalue, split_,
                                           memory_.plain_.rows(), j + n % 2, k + n / 2, family_);
    for (std::int64_t word = 0; word < wordsOf(cells_.count.x); ++word) {
      if (seam[word] == 0) continue;
      // Corner x + 2n of 64 cells.
      std::uint64_t inside[8];
      std::uint64_t any = 0, all = ~std::uint64_t{0};
      const bool has_next = word + 1 < wordsOf(cells_.count.x + 1);
      for (int n = 0; n < 4; ++n) {
        inside[2 * n] = corners[n][word];
        inside[2 * n + 1] =
            corners[n][word] >> 1 | (has_next ? corners[n][word + 1] << 63 : std::uint64_t{0});
        any |= inside[2 * n] | inside[2 * n + 1];
        all &= inside[2 * n] & inside[2 * n + 1];
      }
      for (std::uint64_t left = any & ~all & seam[word]; left != 0; left &= left - 1) {
        const int bit = std::countr_zero(left);
        unsigned pattern = 0;
        for (unsigned c = 0; c < 8; ++c)
          pattern |= static_cast<unsigned>(inside[c] >> bit & 1) << c;
        memory_.seam_cells_.push_back({cells_.first + Index3(64 * word + bit, j, k), pattern});
      }
    }
  }

  // Samples lie far apart, and most are read for the first time: they are asked for ahead of need.
  void meshSeamCells() {
    constexpr std::size_t kAhead = 6;
    const std::vector<SeamCell>& cells = memory_.seam_cells_;
    for (std::size_t n = 0; n < cells.size(); ++n) {
      if (n + kAhead < cells.size()) prefetch(cells[n + kAhead].cell);
      meshLeaf(cells[n].cell, cells[n].pattern);
    }
  }
  // What the gradients at the cell's corners are made of.
  void prefetch(const Index3& cell) {
    const SampleView<T>& own = family_.own();
    const IndexBox& box = own.box();
    for (std::int64_t dz = -1; dz <= 2; ++dz)
      for (std::int64_t dy = -1; dy <= 2; ++dy) {
        if ((dz == -1 || dz == 2) && (dy == -1 || dy == 2)) continue;
        const Index3 sample = cell + Index3(0, dy, dz);
        own.prefetch(glm::clamp(sample, box.first, box.end() - Index3(1)));
      }
  }

  void meshLeaf(const Index3& cell, unsigned pattern) {
    ++batch_.cells;
    const MarchingCubesCase& mc = marchingCubesTable()[pattern];
    const CellVertices vertices = edgeVertices(cell, mc);
    const unsigned finer = facesBesideFiner(cell);
    if (finer == 0)
      addPlainTriangles(context_.frame, mc, vertices, batch_);
    else
      meshTransitionLeaf(cell, pattern, finer, vertices);
  }

  // A corner of a leaf of the seam.
  LatticePoint corner(const Index3& sample) {
    return cornerPoint(lattice_, level_, sample, leaves_.touchesFiner(sample),
                       leaves_.touchesCoarser(sample), family_);
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
    const EdgeKey key = makeEdgeKey(lattice_.position(level_, base), axis);
    if (const std::uint32_t* known = memory_.numbers_.find(key)) return *known;
    const std::uint32_t vertex = makeLeafEdgeVertex(base, axis);
    memory_.numbers_.insert(key,
                            vertex);  // where the edge is a part of a coarser one, that has another
    return vertex;
  }

  std::uint32_t makeLeafEdgeVertex(const Index3& base, int axis) {
    if (const auto plain = memory_.plain_.vertexOn(axis, base - cells_.first)) {
      if (*plain == kNoVertex) failMissingVertex(context_, work_);
      return *plain;
    }
    const LeafEdge edge = leafEdge(lattice_, leaves_, cells_, base, axis);
    if (!edge.is_of_coarser)
      return vertices_.vertexOn(axis, corner(edge.low), corner(edge.high), edge.is_shared);
    const auto ownPoint = [&](const Index3& sample) {
      return LatticePoint{family_.own().value(sample), level_, sample};
    };
    return vertices_.vertexOn(axis, ownPoint(edge.low), ownPoint(edge.high), edge.is_shared);
  }

  // Bit f: the neighbour across face f is refined.
  unsigned facesBesideFiner(const Index3& cell) const {
    unsigned faces = 0;
    for (int face = 0; face < 6; ++face) {
      Index3 neighbour = cell;
      neighbour[face / 2] += face % 2 == 0 ? -1 : 1;
      if (leaves_.isFiner(neighbour)) faces |= 1u << face;
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
    float corner_values[8];
    for (unsigned c = 0; c < 8; ++c)
      corner_values[c] = corner(cell + Index3(c & 1, c >> 1 & 1, c >> 2)).value;
    Contour contour;
    for (int face = 0; face < 6; ++face) {
      if ((finer >> face & 1) == 0)
        addPlainFace(pattern, face, vertices, contour);
      else
        addTransitionFace(makeTransitionFace(lattice_, level_, cell, face, corner_values),
                          context_.isovalue, vertices, vertexInFace, contour);
    }
    const glm::dvec3 low(lattice_.position(level_, cell));
    const glm::dvec3 high(lattice_.position(level_, cell + Index3(1)));
    const glm::dvec3 center = 0.5 * (low + high) - glm::dvec3(batch_.origin);
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
  AdaptiveMesher& memory_;
  BrickSplit& split_;
  const LeafRows& leaves_;
  LeafClassifier classifier_;
  BrickFamily<T> family_;
  BrickVertices<T> vertices_;
};

void AdaptiveMesher::mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch) {
  numbers_.clear();
  batch.origin = brickOrigin(context.lattice(), work.level,
                             context.pyramid.layout().brickCellBox(work.level, work.brick));
  if (!tiles_.load(context, work.level, work.brick)) return;
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    Brick<typename decltype(tag)::Type>(*this, context, work, batch).run();
  });
}

}  // namespace isobrick
