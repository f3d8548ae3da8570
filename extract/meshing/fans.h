// The triangles of a cell beside finer ones (rule 10).
#pragma once

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Appends the fan of a loop of the batch's vertices: around the first of them that shares faces of
// the cell with none but its two neighbours, or, if there is none, around the centre of gravity. So
// no side of a triangle but the loop's own lies in a face, in which another cell might have the
// same side. `cell_center`: like the batch's positions; it takes the place of the centre of gravity
// if that would make a triangle without area, since it lies in no face's plane.
void addFan(const WorldFrame& frame, const glm::dvec3& cell_center, const ContourLoop& loop,
            MeshBatch& batch);

}  // namespace isobrick
