#include "isobrick/extract/geodesic/near_surface.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>

#include "isobrick/extract/sinks/batch_components.h"

namespace isobrick {

QueryBox Ellipsoid::box(const GridGeometry& geometry) const {
  const double between = glm::distance(from, to), half = 0.5 * std::max(sum, between);
  const glm::dvec3 along = between > 0.0 ? (to - from) / between : glm::dvec3(1.0, 0.0, 0.0);
  const double across = half * half - 0.25 * between * between;  // squared half axis
  const glm::dmat3 rows = glm::transpose(glm::inverse(geometry.indexToWorldMatrix()));
  const glm::dvec3 center = geometry.worldToIndex(0.5 * (from + to));
  QueryBox box;
  for (int axis = 0; axis < 3; ++axis) {
    const double part = glm::dot(rows[axis], along);
    const double reach = std::sqrt(across * (glm::dot(rows[axis], rows[axis]) - part * part) +
                                   half * half * part * part);
    box.min[axis] = center[axis] - reach;
    box.max[axis] = center[axis] + reach;
  }
  return box;
}

void NearSurface::begin(const MeshFrame& frame) {
  placement_ = WorldPlacement(frame.geometry);
  sink_.begin(frame);
}

void NearSurface::prepare(PlacedBatch& placed) {
  MeshBatch& batch = placed.batch;
  placed.world.resize(batch.positions.size());
  for (std::uint32_t v = 0; v < placed.world.size(); ++v)
    placed.world[v] = placement_.worldPosition(batch, v);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
    const glm::dvec3& a = placed.world[batch.triangles[i]];
    const double size = std::max(glm::distance(a, placed.world[batch.triangles[i + 1]]),
                                 glm::distance(a, placed.world[batch.triangles[i + 2]]));
    // Over a distance the sum changes by at most twice as much.
    if (glm::distance(a, ellipsoid_.from) + glm::distance(a, ellipsoid_.to) >
        ellipsoid_.sum + 2.0 * size)
      continue;
    for (std::size_t corner = 0; corner < 3; ++corner)
      batch.triangles[kept++] = batch.triangles[i + corner];
  }
  if (kept < batch.triangles.size()) {
    batch.triangles.resize(kept);
    batch.transition_indices = 0;
    dropUnusedVertices(batch, placed.numbers);
  }
  if ((triangles_ += kept / 3) > most_triangles_) throw TooMuchSurface{};
  if (kept > 0) sink_.prepare(placed);
}

}  // namespace isobrick
