// Reads triangle meshes from binary little-endian PLY files, for tests and check_mesh.
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <vector>

namespace isobrick::test {

struct PlyMesh {
  std::vector<glm::dvec3> positions;     // floats are kept exactly
  std::vector<glm::dvec3> normals;       // per vertex, or empty if the file has none
  std::vector<std::uint32_t> triangles;  // three indices each, as they are in the file: unchecked
};

// Reads the elements `vertex` (scalar x y z, perhaps nx ny nz) and `face` (a list vertex_indices or
// vertex_index of three entries); further scalar properties, other lists and other elements are
// skipped. Throws isobrick::Error, with the path, for any other file, a truncated one, bytes after
// the end, or a face that is no triangle.
PlyMesh readPly(const std::filesystem::path& path);

}  // namespace isobrick::test
