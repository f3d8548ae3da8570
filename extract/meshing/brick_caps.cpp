#include "isobrick/extract/meshing/brick_caps.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <utility>

namespace isobrick {

void BrickCaps::begin(const MeshContext& context, const BrickWork& work, const IndexBox& cells,
                      MeshBatch& batch) {
  context_ = &context;
  work_ = &work;
  batch_ = &batch;
  is_below_ = context.query.inside == InsideOf::kBelow;
  cells_ = cells;
  vertices_.clear();
  triangles_.clear();
  points_ = hub_ = 0;
  const Lattice& lattice = context.lattice();
  for (int face = 0; face < 6; ++face) {
    const int axis = face / 2;
    border_cell_[face] = -2;
    for (std::int64_t i = 0; i < cells.count[axis]; ++i) {
      IndexBox layer = cells;
      layer.first[axis] += i;
      layer.count[axis] = 1;
      if ((context.border.facesOf(lattice, work.level, layer) >> face & 1) == 0) continue;
      border_cell_[face] = i;
      if (face % 2 == 1) break;
    }
  }
}

void BrickCaps::addHalved(const TransitionFace& face, const Contour& contour) {
  const FaceParts parts{face.parts_b, face.parts_c};
  const auto& points = kHalvedFacePoints[static_cast<std::size_t>(2 * face.axis + face.side)];
  for (int part_c = 0; part_c < parts.c; ++part_c)
    for (int part_b = 0; part_b < parts.b; ++part_b) {
      FaceCorner corners[4];
      bool inside[4];
      for (int n = 0; n < 4; ++n) {
        const FaceCorner at = kFaceLoop[face.side][n];
        corners[n] = {static_cast<std::uint8_t>(part_b + at.b),
                      static_cast<std::uint8_t>(part_c + at.c)};
        inside[n] = isInside(face.values[corners[n].c][corners[n].b]);
      }
      addPolygons(
          inside,
          [&](int n) {
            const LatticePoint point = face.point(corners[n].b, corners[n].c);
            return vertexAt(context_->lattice().position(point.level, point.sample), true);
          },
          [&](int n) {
            const int edge = halvedFaceEdge(parts, corners[n], corners[(n + 1) % 4]);
            return contour.numbers[points[static_cast<std::size_t>(edge)]];
          },
          [](int) { return std::optional<std::uint32_t>(); });
    }
}

void BrickCaps::endPolygon() {
  // Counter-clockwise seen from outside of the volume, whatever side of the surface is inside.
  const bool turns = context_->frame.mirrored() != is_below_;
  for (std::size_t step = 1; step + 1 < points_; ++step) {
    std::uint32_t second = polygon_[(hub_ + step) % points_];
    std::uint32_t third = polygon_[(hub_ + step + 1) % points_];
    if (turns) std::swap(second, third);
    triangles_.insert(triangles_.end(), {polygon_[hub_], second, third});
  }
  points_ = hub_ = 0;
}

std::uint32_t BrickCaps::vertexAt(const Index3& position, bool is_shared) {
  const auto next = static_cast<std::uint32_t>(batch_->positions.size());
  const EdgeKey key = makeEdgeKey(position, 3);
  bool is_new = false;
  const std::uint32_t vertex = vertices_.findOrInsert(key, next, &is_new);
  if (!is_new) return vertex;
  batch_->positions.push_back(glm::vec3(position - batch_->origin));
  // The mean of the sides of the border that it lies in.
  const unsigned faces = context_->border.facesOf(context_->lattice(), 0, {position, Index3(0)});
  glm::vec3 normal(0.0f);
  for (int face = 0; face < 6; ++face)
    if ((faces >> face & 1) != 0)
      normal += context_->frame.normal(glm::vec3(0.0f), face / 2, (face % 2 == 1) != is_below_);
  batch_->normals.push_back(glm::normalize(normal));
  if (is_shared) batch_->shared.push_back({vertex, 0, key});
  return vertex;
}

std::optional<Index3> BrickCaps::middleOf(const Edge& edge) const {
  const Lattice& lattice = context_->lattice();
  const Index3 sample = cells_.first + edge.corner;
  const std::int64_t middle = 2 * sample[edge.axis] + 1;
  if (isOnCoarserLattice(lattice, work_->level - 1, edge.axis, middle)) return std::nullopt;
  Index3 position = lattice.position(work_->level, sample);
  position[edge.axis] = lattice.position(work_->level - 1, edge.axis, middle);
  return position;
}

void BrickCaps::finish() {
  batch_->cap_indices = triangles_.size();
  batch_->triangles.insert(batch_->triangles.end(), triangles_.begin(), triangles_.end());
}

}  // namespace isobrick
