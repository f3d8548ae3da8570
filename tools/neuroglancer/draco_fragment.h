// A fragment of a mesh, packed by Draco.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace isobrick {

// Packs positions of small integers, as they are, and triangles of three indices into them each. A
// position may come back as several equal ones. From any number of threads at once. Throws
// std::runtime_error if Draco refuses the mesh.
std::vector<char> packFragment(std::span<const glm::ivec3> positions,
                               std::span<const std::uint32_t> triangles);

}  // namespace isobrick
