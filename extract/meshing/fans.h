// The triangles of a cell beside finer ones (rule 10).
#pragma once

#include <span>

#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Appends a fan around the centre of gravity of a loop of the batch's vertices, whose pieces lie in
// the faces of one cell. `cell_center`: like the batch's positions; it takes the place of the
// centre of gravity where that would make a triangle without area, since it sees all faces from a
// height.
void addFan(const WorldFrame& frame, const glm::dvec3& cell_center,
            std::span<const std::uint32_t> loop, MeshBatch& batch);

}  // namespace isobrick
