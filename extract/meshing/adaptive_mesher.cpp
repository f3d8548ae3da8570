#include "isobrick/extract/meshing/adaptive_mesher.h"

#include <bit>
#include <cmath>

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/marching_cubes_table.h"
#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/corner_values.h"
#include "isobrick/extract/meshing/shared_vertices.h"
#include "isobrick/extract/meshing/transition_edge.h"
#include "isobrick/extract/meshing/transition_face.h"
#include "isobrick/extract/sinks/triangle_sink.h"

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
        corners_(memory.corners_),
        leaves_(memory.split_.leaves()),
        classifier_(context, BrickReads::kAllowed),
        family_(context, leaves_, level_, work.brick),
        vertices_(context, family_, memory.edges_, batch) {}

  void run() {
    BrickCells& kernels = memory_.cells_;
    BrickRows& rows = kernels.rows();
    kernels.reset(cells_);
    split_.split(context_, classifier_, memory_.tiles_, level_, cells_, rows);
    if (!split_.hasLeaves()) return;
    context_.checkCancel();
    corners_.reset(lattice_, split_, cells_, rows);
    if (!kernels.template compare<T>(context_, work_, family_.ownSamples())) return;
    corners_.resolve(lattice_, context_.isovalue, split_, family_, rows);
    if (context_.pyramid.spec().has_missing) leaveOutMissing(rows);
    kernels.number();
    batch_.cells += rows.crossed_cell_count;
    takeFans(rows);
    context_.checkCancel();
    kernels.template make<T>(context_, work_, family_.ownSamples(), batch_);
    if (context_.pyramid.spec().has_missing) mendNormals(rows);
    SharedVertices(rows, lattice_, level_, cells_, batch_)
        .list(corners_, [this](std::uint32_t vertex, int axis, const Index3& at) {
          makeZoneVertex(vertex, axis, at);
        });
    const std::size_t plain_indices = batch_.triangles.size();
    if (context_.query.cap) memory_.caps_.begin(context_, work_, cells_, batch_);
    for (const FanCell& fan : memory_.fan_cells_) meshFans(fan);
    vertices_.flush();
    batch_.transition_indices = batch_.triangles.size() - plain_indices;
    if (context_.query.cap) memory_.caps_.add(kernels, rows, LevelsAround{*this});
  }

 private:
  // The crossed cells that touch a voxel without data are not wanted: those of which a sample at a
  // corner is one, or a corner's value by rule 6 comes from one. Whether a sample is one depends on
  // its voxel alone and not on the level. So a cell beside a transition that stays has numbers on
  // all of its faces, and each cell decides for itself: its neighbours are open there.
  void leaveOutMissing(BrickRows& rows) {
    const SampleView<T>& own = family_.own();
    const auto isMissing = [&](const Index3& at, bool in_zone) {
      const Index3 sample = cells_.first + at;
      if (own.isMissing(*own.at(own.offset(sample)))) return true;
      if (!in_zone) return false;
      const auto [finer, coarser] = corners_.touching(at);
      return coarser && !finer && std::isnan(ownValueOnCoarserLeaf(lattice_, level_, sample, own));
    };
    for (std::int64_t k = 0; k < cells_.count.z; ++k)
      for (std::int64_t j = 0; j < cells_.count.y; ++j)
        for (std::int64_t word = 0; word < rows.words_per_row; ++word) {
          std::uint64_t& wanted = rows.wantedCells(j, k)[word];
          if (wanted == 0) continue;
          const std::uint64_t zone = split_.zone(j, k)[word];
          // Of those that are not crossed there may be caps alone.
          std::uint64_t used = wanted;
          if (!context_.query.cap)
            used = CellWords(rows, rows.row(j, k), word).crossedCells(wanted);
          for (; used != 0; used &= used - 1) {
            const int bit = std::countr_zero(used);
            bool is_missing = false;
            for (int c = 0; c < 8 && !is_missing; ++c)
              is_missing =
                  isMissing(Index3(64 * word + bit, j, k) + Index3(c & 1, c >> 1 & 1, c >> 2),
                            (zone >> bit & 1) != 0);
            if (is_missing) wanted &= ~(std::uint64_t{1} << bit);
          }
        }
  }

  // Gradients beside voxels without data are one-sided, which the kernels do not know.
  void mendNormals(const BrickRows& rows) {
    const SampleView<T>& own = family_.own();
    for (int axis = 0; axis < 3; ++axis)
      for (const std::uint32_t r : rows.crossed_rows[static_cast<std::size_t>(axis)].list()) {
        Index3 at(0, r % rows.rowsPerSlice(), r / rows.rowsPerSlice());
        for (; at.x < cells_.count.x + (axis == 0 ? 0 : 1); ++at.x) {
          const std::uint32_t vertex = memory_.cells_.vertexOn(axis, at);
          if (vertex == kNoVertex) continue;
          const Index3 low = cells_.first + at;
          Index3 high = low;
          ++high[axis];
          if (!own.isBesideMissing(low) && !own.isBesideMissing(high)) continue;
          vertices_.put(vertex, axis, level_, low, high, false);
          own.end(low, vertices_.low());
          own.end(high, vertices_.high());
        }
      }
  }

  // Lists the cells that are fans: those crossed in a face beside finer leaves. The others keep
  // their triangles.
  void takeFans(BrickRows& rows) {
    memory_.fan_cells_.clear();
    if (level_ == 0) return;
    for (const auto& [j, k] : split_.zoneRows()) {
      const std::int64_t r = rows.row(j, k);
      for (std::int64_t word = 0; word < rows.words_per_row; ++word) {
        const std::uint64_t zone = split_.zone(j, k)[word] & rows.wanted(r)[word];
        if (zone == 0) continue;
        std::array<std::uint64_t, 6> finer = leaves_.besideFiner(j, k, word);
        if (((finer[0] | finer[1] | finer[2] | finer[3] | finer[4] | finer[5]) & zone) == 0)
          continue;
        const CellWords corners(rows, r, word);
        std::uint64_t fans = 0;
        for (int face = 0; face < 6; ++face) {
          finer[static_cast<std::size_t>(face)] &= corners.crossed(face) & zone;
          fans |= finer[static_cast<std::size_t>(face)];
        }
        rows.crossed_cells[static_cast<std::size_t>(r * rows.words_per_row + word)] &= ~fans;
        for (std::uint64_t left = fans; left != 0; left &= left - 1) {
          const int bit = std::countr_zero(left);
          const unsigned pattern = corners.pattern(bit);
          unsigned faces = 0;
          for (std::size_t face = 0; face < 6; ++face)
            faces |= static_cast<unsigned>(finer[face] >> bit & 1) << face;
          rows.triangles -= marchingCubesTable()[pattern].triangle_count;
          memory_.fan_cells_.push_back(
              {cells_.first + Index3(64 * word + bit, j, k), pattern, faces});
        }
      }
    }
  }

  // Corners of leaves of the zone, counted from the brick's first.
  float cornerValueAt(const Index3& at) {
    const auto [finer, coarser] = corners_.touching(at);
    return cornerValue(lattice_, level_, cells_.first + at, finer, coarser, family_);
  }
  void takeCorner(const Index3& at, EdgeEnd& out) {
    const auto [finer, coarser] = corners_.touching(at);
    cornerEnd(lattice_, level_, cells_.first + at, finer, coarser, family_, out);
  }

  // On the edge along `axis` from corner `at`, of which leaves of another level touch an end; it
  // may be half of a coarser leaf's edge (rule 8).
  void makeZoneVertex(std::uint32_t vertex, int axis, const Index3& at) {
    const LeafRows::EdgeBits around = zone_edges_.around(leaves_, axis, at);
    const int b = (axis + 1) % 3, c = (axis + 2) % 3;
    const bool is_shared = (around.beside_finer | around.beside_coarser) != 0 || at[b] == 0 ||
                           at[b] == cells_.count[b] || at[c] == 0 || at[c] == cells_.count[c];
    Index3 low = cells_.first + at, high = low;
    if (around.beside_coarser != 0 && isOnCoarserLattice(lattice_, level_, b, low[b]) &&
        isOnCoarserLattice(lattice_, level_, c, low[c]))
      return vertices_.putHalf(vertex, axis, level_, low, is_shared);
    Index3 next = at;
    ++next[axis];
    ++high[axis];
    vertices_.put(vertex, axis, level_, low, high, is_shared);
    takeCorner(at, vertices_.low());
    takeCorner(next, vertices_.high());
    if (around.beside_finer != 0) vertices_.keepBeside(level_ - 1, axis, 2 * low[axis] + 1);
  }

  // Rule 10: the contour follows the fine side's polyline on every transition face, and every loop
  // becomes a fan.
  void meshFans(const FanCell& fan) {
    const auto& [cell, pattern, finer] = fan;
    ++batch_.transition_cells;
    const Index3 first = cell - cells_.first;
    const auto numberOf = [&](int edge) {
      const CellEdge& e = kCellEdgeTable[static_cast<std::size_t>(edge)];
      return memory_.cells_.vertexOn(e.axis, first + Index3(e.x, e.y, e.z));
    };
    const auto makeVertex = [&](int axis, const LatticePoint& low, const LatticePoint& high) {
      return vertices_.append(axis, low, high);
    };
    float values[8];
    unsigned known = 0;  // of them
    Contour contour;
    for (int face = 0; face < 6; ++face) {
      // Between corners of one kind all values are of that kind.
      const unsigned mask = faceCorners(face), inside = pattern & mask;
      if (inside == 0 || inside == mask) continue;
      if ((finer >> face & 1) == 0) {
        const FaceContour& pieces = plainFace(face, pattern);
        for (std::size_t n = 0; n < pieces.size; ++n) {
          const auto [from, to] = pieces.pieces[n];
          for (const std::uint8_t point : {from, to})
            if (!contour.isKnown(point)) contour.setNumber(point, numberOf(point));
          contour.add(from, to, face);
        }
        continue;
      }
      for (unsigned rest = mask & ~known; rest != 0; rest &= rest - 1) {
        const auto c = static_cast<unsigned>(std::countr_zero(rest));
        values[c] = cornerValueAt(first + Index3(c & 1, c >> 1 & 1, c >> 2));
      }
      known |= mask;
      const TransitionFace halved = makeTransitionFace(lattice_, level_, cell, face, values);
      addTransitionFace(halved, context_.isovalue, numberOf, makeVertex, contour);
      if (context_.query.cap && memory_.caps_.isInBorder(first, face))
        memory_.caps_.addHalved(halved, contour);
    }
    SeveralFans& fans = memory_.fans_;
    fans.clear();
    if (!forEachLoop(contour, [&](const ContourLoop& loop) { fans.add(loop); }))
      context_.failMissingVertex(work_);
    if (fans.loops() == 1)
      if (const auto hub = hubOf(fans.loop(0)))
        return addFan(context_.frame, fans.loop(0), *hub, batch_);
    vertices_.flush();
    if (fans.loops() == 1)
      addCenteredFan(context_.frame, centerOf(fan.cell), fans.loop(0), batch_);
    else
      fans.append(context_.frame, cornerOf(fan.cell), centerOf(fan.cell), batch_);
  }

  // Of a cell, counted like positions.
  glm::dvec3 cornerOf(const Index3& cell) const {
    return glm::dvec3(lattice_.position(level_, cell)) - glm::dvec3(batch_.origin);
  }

  glm::dvec3 centerOf(const Index3& cell) const {
    const glm::dvec3 low(lattice_.position(level_, cell));
    const glm::dvec3 high(lattice_.position(level_, cell + Index3(1)));
    return 0.5 * (low + high) - glm::dvec3(batch_.origin);
  }

  // The leaves that touch the edges of one word; edges are looked up in order.
  class ZoneEdges {
   public:
    LeafRows::EdgeBits around(const LeafRows& leaves, int axis, const Index3& at) {
      if (axis != 0 && at.x == 0) return leaves.firstEdgeAround(axis, at.y, at.z);
      const std::int64_t bit = axis == 0 ? at.x : at.x - 1;
      const std::int64_t word = bit / 64;
      if (axis != axis_ || at.y != j_ || at.z != k_ || word != word_) {
        axis_ = axis;
        j_ = at.y;
        k_ = at.z;
        word_ = word;
        bits_ = leaves.edgesAround(axis, j_, k_, word);
      }
      return {bits_.beside_finer >> bit % 64 & 1, bits_.beside_coarser >> bit % 64 & 1};
    }

   private:
    int axis_ = -1;
    std::int64_t j_ = 0, k_ = 0, word_ = 0;
    LeafRows::EdgeBits bits_;
  };

  // As NoOtherLevels.
  struct LevelsAround {
    Brick& brick;

    bool hasAny(const Index3& cell) const {
      return (brick.split_.zone(cell.y, cell.z)[cell.x / 64] >> cell.x % 64 & 1) != 0;
    }
    bool isBesideFiner(const Index3& cell, int face) const {
      const auto finer = brick.leaves_.besideFiner(cell.y, cell.z, cell.x / 64);
      return (finer[static_cast<std::size_t>(face)] >> cell.x % 64 & 1) != 0;
    }
    bool isHalved(int axis, const Index3& corner) const {
      return brick.zone_edges_.around(brick.leaves_, axis, corner).beside_finer != 0;
    }
  };

  const MeshContext& context_;
  const BrickWork& work_;
  MeshBatch& batch_;
  const Lattice& lattice_;
  const int level_;
  const IndexBox cells_;
  AdaptiveMesher& memory_;
  BrickSplit& split_;
  TransitionCorners& corners_;
  const LeafRows& leaves_;
  LeafClassifier classifier_;
  BrickFamily<T> family_;
  TransitionEdges<T> vertices_;
  ZoneEdges zone_edges_;
};

void AdaptiveMesher::mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch) {
  batch.origin = brickOrigin(context.lattice(), work.level,
                             context.pyramid.layout().brickCellBox(work.level, work.brick));
  if (!tiles_.load(context, work.level, work.brick)) return;
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    Brick<typename decltype(tag)::Type>(*this, context, work, batch).run();
  });
}

}  // namespace isobrick
