// The triangles of a cell beside finer ones (rule 10).
#pragma once

#include <optional>

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// The fan of a loop is around its hub: the first vertex that shares faces of the cell with none but
// its two neighbours. If there is none, it is around the loop's centre of gravity. So no side of a
// triangle but the loop's own lies in a face, in which another cell might have the same side.
std::optional<std::size_t> hubOf(const ContourLoop& loop);

// Append the fan of a loop of the batch's vertices. `hub`: that of hubOf().
void addFan(const WorldFrame& frame, const ContourLoop& loop, std::size_t hub, MeshBatch& batch);
// The positions of the loop's vertices are used. `cell_center`: like the batch's positions; it
// takes the place of the centre of gravity if that would make a triangle without area, since it
// lies in no face's plane.
void addCenteredFan(const WorldFrame& frame, const glm::dvec3& cell_center, const ContourLoop& loop,
                    MeshBatch& batch);

}  // namespace isobrick
