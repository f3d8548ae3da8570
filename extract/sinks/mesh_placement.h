// Meshes of files that lie elsewhere than in their volume's world: other axes, another unit, moved.
#pragma once

#include <memory>
#include <string>

#include "isobrick/extract/sinks/mesh_file_sink.h"

namespace isobrick {

// Gives the mesh to `sink` as it is to lie: its frame, and batches with turned normals and, if the
// axes change their handedness, turned triangles.
std::unique_ptr<MeshFileSink> placedSink(std::unique_ptr<MeshFileSink> sink,
                                         const MeshPlacement& placement);

// The words of headers on coordinates.
std::string spaceText(const MeshFrame& frame);
std::string unitText(const MeshFrame& frame);
// None: (0, 0, 0).
glm::dvec3 shiftOf(const MeshFrame& frame);

}  // namespace isobrick
