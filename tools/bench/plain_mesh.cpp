#include "tools/bench/plain_mesh.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fstream>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

struct PlainMeshHeader {
  std::uint64_t vertices = 0, triangles = 0;
};
constexpr std::uint64_t kBytesEach = 12;  // of a position, and of a triangle

template <typename T>
void writeAll(std::ofstream& file, const std::vector<T>& values) {
  file.write(reinterpret_cast<const char*>(values.data()),
             static_cast<std::streamsize>(values.size() * sizeof(T)));
}

template <typename T>
void readAll(std::ifstream& file, std::vector<T>& values) {
  file.read(reinterpret_cast<char*>(values.data()),
            static_cast<std::streamsize>(values.size() * sizeof(T)));
}

}  // namespace

void writePlainMesh(const PlainMesh& mesh, const std::string& path) {
  std::ofstream file(path, std::ios::binary);
  const PlainMeshHeader header{mesh.positions.size(), mesh.triangles.size()};
  file.write(reinterpret_cast<const char*>(&header), sizeof header);
  writeAll(file, mesh.positions);
  writeAll(file, mesh.triangles);
  file.close();
  if (!file)
    throw Error(fmt::format("cannot write '{}': {}; set TMPDIR to a folder with more room", path,
                            std::strerror(errno)));
}

PlainMesh readPlainMesh(const std::string& path) {
  const auto fail = [&](const char* why) {
    throw Error(fmt::format("cannot read the mesh '{}': {}", path, why));
  };
  std::ifstream file(path, std::ios::binary);
  PlainMeshHeader header;
  file.read(reinterpret_cast<char*>(&header), sizeof header);
  if (!file) fail("it is not there, or shorter than its header");
  const std::uint64_t most = fileBytes(path) / kBytesEach;
  if (header.vertices > most || header.triangles > most ||
      sizeof header + kBytesEach * (header.vertices + header.triangles) != fileBytes(path))
    fail("its size is not that of what it says to hold");
  PlainMesh mesh;
  mesh.positions.resize(header.vertices);
  mesh.triangles.resize(header.triangles);
  readAll(file, mesh.positions);
  readAll(file, mesh.triangles);
  if (!file) fail("it is shorter than it says");
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t vertex : triangle)
      if (vertex >= header.vertices) fail("a triangle has a vertex that is not there");
  return mesh;
}

}  // namespace isobrick
