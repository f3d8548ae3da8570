// The triangles of a cell, plain and as fans (rule 10).
#pragma once

#include <span>
#include <utility>

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/kernels/marching_cubes_table.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Appends a triangle of vertices of the batch, turned round where the world is mirrored.
inline void addTriangle(const WorldFrame& frame, std::uint32_t a, std::uint32_t b, std::uint32_t c,
                        MeshBatch& batch) {
  if (frame.mirrored()) std::swap(b, c);
  batch.triangles.insert(batch.triangles.end(), {a, b, c});
}

// Appends the triangles of a cell without a transition.
inline void addPlainTriangles(const WorldFrame& frame, const MarchingCubesCase& mc,
                              const CellVertices& vertices, MeshBatch& batch) {
  for (std::size_t t = 0; t < 3u * mc.triangle_count; t += 3)
    addTriangle(frame, vertices[mc.edges[t]], vertices[mc.edges[t + 1]], vertices[mc.edges[t + 2]],
                batch);
}

// Appends a fan around the centre of gravity of a loop of the batch's vertices, whose pieces lie in
// the faces of one cell. `cell_center`: like the batch's positions; it takes the place of the
// centre of gravity where that would make a triangle without area, since it sees all faces from a
// height.
void addFan(const WorldFrame& frame, const glm::dvec3& cell_center,
            std::span<const std::uint32_t> loop, MeshBatch& batch);

}  // namespace isobrick
