// Caps (Query::cap): what closes a surface in the border of the volume or of the query's box, as if
// all values beyond were outside.
//
// The cap of a leaf is the inside part of its faces in the border, as marching squares of the
// face's corners (rule 6) bound it: by the segments of the leaf's own contour there. Its points are
// the crossings on the face's edges, the inside corners, and, on an edge of which finer leaves have
// the halves, its middle, if that is inside. Each is one vertex for all faces around it. A face
// that the surface crosses beside finer leaves, which lie beyond the query's box, is capped in its
// halves.
//
// Such a polygon is convex, and has three points on a line only if one of them is the middle of an
// edge. So a fan around a middle, or around any point if there is none, has no flat triangle, and
// all of its inner sides lie within the face, where no other triangle has one.
#pragma once

#include <bit>
#include <cstdint>
#include <optional>
#include <vector>

#include "isobrick/extract/cap_border.h"
#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/meshing/brick_cells.h"
#include "isobrick/extract/meshing/transition_face.h"
#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/extract/sinks/edge_vertex_map.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// What a brick's caps need to know of leaves of other levels around a cell or an edge, which are
// counted from the brick's first: here that there are none.
struct NoOtherLevels {
  static bool hasAny(const Index3&) { return false; }
  static bool isBesideFiner(const Index3&, int) { return false; }
  static bool isHalved(int, const Index3&) { return false; }
};

// Makes the caps of one brick after the other, behind the brick's other triangles, and reuses its
// memory. One object serves one thread. The order of calls: begin(); addHalved() for faces that
// fans leave to it; add(), which puts them all into the batch.
class BrickCaps {
 public:
  // `batch` is that of begin() until add(); its origin is set.
  void begin(const MeshContext& context, const BrickWork& work, const IndexBox& cells,
             MeshBatch& batch);

  // Whether a face of a leaf lies in the border.
  bool isInBorder(const Index3& cell, int face) const { return (facesOf(cell) >> face & 1) != 0; }
  // Caps a face in the border, the surface's contour on which is that of the finer leaves beyond.
  void addHalved(const TransitionFace& face, const Contour& contour);
  // Caps all other faces in the border, of wanted cells. All crossings of the brick have their
  // places in the batch. `others`: as NoOtherLevels.
  template <typename Others>
  void add(const BrickCells& brick_cells, BrickRows& rows, Others&& others);

 private:
  // An edge of a cell.
  struct Edge {
    Index3 corner{0};  // its lower end, counted from the brick's first
    int axis = 0;
  };

  unsigned facesOf(const Index3& cell) const {
    unsigned faces = 0;
    for (int face = 0; face < 6; ++face)
      faces |= static_cast<unsigned>(cell[face / 2] == border_cell_[face]) << face;
    return faces;
  }
  // Whether a corner lies in a side of the brick beyond which other bricks have leaves.
  bool isBesideBrick(const Index3& corner) const {
    bool is_beside = false;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::int64_t at = corner[static_cast<int>(axis)];
      const std::int64_t count = cells_.count[static_cast<int>(axis)];
      is_beside = is_beside || (at == 0 && border_cell_[2 * axis] != 0) ||
                  (at == count && border_cell_[2 * axis + 1] != count - 1);
    }
    return is_beside;
  }
  bool isInside(float value) const { return (value >= context_->isovalue) != is_below_; }

  template <typename Others>
  void addFace(const BrickCells& brick_cells, const Index3& cell, int face, unsigned inside_corners,
               Others&& others);
  // The polygons of a face whose corners, counter-clockwise seen from outside, are inside or not.
  // cornerAt(n) and crossingAt(n) give vertices, those of a corner and of the edge behind it;
  // middleAt(n) that of the middle of this edge, if it is a point.
  template <typename Corner, typename Crossing, typename Middle>
  void addPolygons(const bool (&inside)[4], Corner&& cornerAt, Crossing&& crossingAt,
                   Middle&& middleAt);
  void endPolygon();
  void addPoint(std::uint32_t vertex) {
    if (vertex == kNoVertex) context_->failMissingVertex(*work_);
    polygon_[points_++] = vertex;
  }
  // The vertex at a lattice point; `is_shared`: other bricks may have it.
  std::uint32_t vertexAt(const Index3& position, bool is_shared);
  // Where leaves of another level halve the edge; none if it is too short.
  std::optional<Index3> middleOf(const Edge& edge) const;
  void finish();

  static constexpr std::size_t kMostPoints = 12;

  const MeshContext* context_ = nullptr;
  const BrickWork* work_ = nullptr;
  MeshBatch* batch_ = nullptr;
  bool is_below_ = false;  // Query::inside
  IndexBox cells_;
  std::int64_t
      border_cell_[6];  // of cells with that face in the border: their place along the axis
  EdgeVertexMap<std::uint32_t> vertices_;  // of lattice points
  std::vector<std::uint32_t> triangles_;
  std::uint32_t polygon_[kMostPoints];
  std::size_t points_ = 0, hub_ = 0;  // of the polygon
};

template <typename Others>
void BrickCaps::add(const BrickCells& brick_cells, BrickRows& rows, Others&& others) {
  for (std::int64_t k = 0; k < cells_.count.z; ++k)
    for (std::int64_t j = 0; j < cells_.count.y; ++j) {
      const unsigned row_faces = facesOf({-1, j, k});
      for (std::int64_t word = 0; word < rows.words_per_row; ++word) {
        std::uint64_t wanted = rows.wantedCells(j, k)[word];
        if (row_faces == 0)
          wanted &= bitsBetween(border_cell_[0], border_cell_[0] + 1, word) |
                    bitsBetween(border_cell_[1], border_cell_[1] + 1, word);
        if (wanted == 0) continue;
        const CellWords corners(rows, rows.row(j, k), word);
        for (; wanted != 0; wanted &= wanted - 1) {
          const int bit = std::countr_zero(wanted);
          const Index3 cell(64 * word + bit, j, k);
          const unsigned above = corners.pattern(bit), inside = is_below_ ? ~above & 0xFF : above;
          if (inside == 0) continue;
          // Other cells have triangles of the surface.
          batch_->cells += inside == 0xFF ? 1 : 0;
          for (unsigned faces = facesOf(cell); faces != 0; faces &= faces - 1)
            addFace(brick_cells, cell, std::countr_zero(faces), inside, others);
        }
      }
    }
  finish();
}

template <typename Others>
void BrickCaps::addFace(const BrickCells& brick_cells, const Index3& cell, int face,
                        unsigned inside_corners, Others&& others) {
  const unsigned mask = faceCorners(face);
  if ((inside_corners & mask) == 0) return;
  const bool has_others = others.hasAny(cell);
  // addHalved() did it.
  if ((inside_corners & mask) != mask && has_others && others.isBesideFiner(cell, face)) return;
  const int axis = face / 2, side = face % 2, b = (axis + 1) % 3, c = (axis + 2) % 3;
  Index3 corners[4];
  bool inside[4];
  for (int n = 0; n < 4; ++n) {
    const FaceCorner at = kFaceLoop[side][n];
    corners[n] = cell;
    corners[n][axis] += side;
    corners[n][b] += at.b;
    corners[n][c] += at.c;
    inside[n] = (inside_corners >> (side << axis | at.b << b | at.c << c) & 1) != 0;
  }
  const auto edgeAfter = [&](int n) {
    const Index3 &from = corners[n], &to = corners[(n + 1) % 4];
    return Edge{glm::min(from, to), from[b] != to[b] ? b : c};
  };
  const auto crossingAt = [&](int n) {
    const Edge edge = edgeAfter(n);
    return brick_cells.vertexOn(edge.axis, edge.corner);
  };
  const auto cornerAt = [&](int n) {
    return vertexAt(context_->lattice().position(work_->level, cells_.first + corners[n]),
                    has_others || isBesideBrick(corners[n]));
  };
  addPolygons(inside, cornerAt, crossingAt, [&](int n) -> std::optional<std::uint32_t> {
    const Edge edge = edgeAfter(n);
    if (!has_others || !others.isHalved(edge.axis, edge.corner)) return std::nullopt;
    const std::optional<Index3> middle = middleOf(edge);
    if (!middle) return std::nullopt;
    if (inside[n] != inside[(n + 1) % 4]) {
      // The crossing lies beside the middle, on the side that has other values at its ends (rule
      // 8).
      const std::uint32_t crossing = crossingAt(n);
      if (crossing == kNoVertex) return std::nullopt;
      const bool low_is_inside = inside[corners[n] == edge.corner ? n : (n + 1) % 4];
      const auto place = static_cast<float>((*middle - batch_->origin)[edge.axis]);
      if ((batch_->positions[crossing][edge.axis] > place) != low_is_inside) return std::nullopt;
    }
    return vertexAt(*middle, true);
  });
}

template <typename Corner, typename Crossing, typename Middle>
void BrickCaps::addPolygons(const bool (&inside)[4], Corner&& cornerAt, Crossing&& crossingAt,
                            Middle&& middleAt) {
  // From an outside corner on, if there is one.
  int first = 0;
  while (first < 3 && inside[first]) ++first;
  for (int step = 0; step < 4; ++step) {
    const int n = (first + step) % 4, next = (n + 1) % 4;
    if (inside[n]) {
      addPoint(cornerAt(n));
    } else if (!is_below_) {
      endPolygon();  // corners above the isovalue are kept apart (rule 9)
    }
    if (!inside[n] && !inside[next]) continue;
    const auto addMiddle = [&] {
      const std::optional<std::uint32_t> middle = middleAt(n);
      if (!middle) return;
      hub_ = points_;
      addPoint(*middle);
    };
    if (inside[n]) addMiddle();
    if (inside[n] != inside[next]) addPoint(crossingAt(n));
    if (!inside[n]) addMiddle();
  }
  endPolygon();
}

}  // namespace isobrick
