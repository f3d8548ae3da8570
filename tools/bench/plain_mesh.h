// A mesh as it passes from the process that made it to the one that compares it.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace isobrick {

// Also included as C++17, for VTK's sake.
struct PlainMesh {
  std::vector<std::array<float, 3>> positions;          // in voxel indices
  std::vector<std::array<std::uint32_t, 3>> triangles;  // numbers of positions
};

// A temporary file, in the byte order of this machine. Both throw Error that names the file;
// reading also if its size or a number in it does not fit.
void writePlainMesh(const PlainMesh& mesh, const std::string& path);
PlainMesh readPlainMesh(const std::string& path);

}  // namespace isobrick
