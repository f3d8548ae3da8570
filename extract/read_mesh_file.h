// Meshes of other programs, as far as their shape goes.
#pragma once

#include <string>

#include "isobrick/extract/sinks/indexed_mesh.h"

namespace isobrick {

// The positions and triangles of a mesh: .ply, as text or binary little-endian, whose polygons
// become fans; or .stl, binary, of which equal corners are one vertex. Throws Error, with the path,
// for other formats and for files that are damaged or of more than 2^32 - 1 vertices.
IndexedMesh readMeshFile(const std::string& path);

}  // namespace isobrick
