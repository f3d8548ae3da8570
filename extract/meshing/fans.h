// The triangles of a cell beside finer ones (rule 10).
#pragma once

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Appends the fan of a loop of the batch's vertices: around the first of them that lies in no face
// of the cell with another one but its two neighbours, or where there is none, around the centre of
// gravity. So no side of a triangle but the loop's own lies in a face, where another cell might
// have it too. `cell_center`: like the batch's positions; it takes the place of the centre of
// gravity where that would make a triangle without area, since it sees all faces from a height.
void addFan(const WorldFrame& frame, const glm::dvec3& cell_center, const ContourLoop& loop,
            MeshBatch& batch);

}  // namespace isobrick
