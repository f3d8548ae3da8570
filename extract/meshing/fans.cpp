#include "isobrick/extract/meshing/fans.h"

#include <cmath>
#include <glm/common.hpp>
#include <utility>

#include "isobrick/extract/kernels/crossing.h"

namespace isobrick {
namespace {

bool hasFlatTriangle(const glm::dvec3& center, std::span<const std::uint32_t> loop,
                     const MeshBatch& batch) {
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const glm::dvec3 area =
        glm::cross(glm::dvec3(batch.positions[loop[i]]) - center,
                   glm::dvec3(batch.positions[loop[(i + 1) % loop.size()]]) - center);
    if (!(glm::dot(area, area) > 0)) return true;
  }
  return false;
}

// Appends a triangle of vertices of the batch, turned round if the world is mirrored.
void addTriangle(const WorldFrame& frame, std::uint32_t a, std::uint32_t b, std::uint32_t c,
                 MeshBatch& batch) {
  if (frame.mirrored()) std::swap(b, c);
  batch.triangles.insert(batch.triangles.end(), {a, b, c});
}

// The nearest point whose coordinates are ones that crossings of the level may have: exact in float
// from the origin of any brick, so the same point whatever the brick.
glm::dvec3 onCrossingGrid(const glm::dvec3& point, int level) {
  const double steps = std::ldexp(1.0, kCrossingBits - level);
  return glm::floor(point * steps + 0.5) / steps;
}

// Whether the sides from a vertex of the loop to all others lie within the cell, or are the loop's.
bool seesAll(std::span<const std::uint8_t> faces, std::size_t vertex) {
  for (std::size_t step = 2; step + 1 < faces.size(); ++step)
    if ((faces[vertex] & faces[(vertex + step) % faces.size()]) != 0) return false;
  return true;
}

// Appends the centre of gravity to the vertices.
std::uint32_t addCenter(const glm::dvec3& cell_center, std::span<const std::uint32_t> loop,
                        MeshBatch& batch) {
  glm::dvec3 center(0.0), normal(0.0);
  for (const std::uint32_t vertex : loop) {
    center += glm::dvec3(batch.positions[vertex]);
    normal += glm::dvec3(batch.normals[vertex]);
  }
  center = onCrossingGrid(center / static_cast<double>(loop.size()), batch.level);
  if (hasFlatTriangle(center, loop, batch)) center = cell_center;
  const double norm = std::sqrt(glm::dot(normal, normal));
  const auto number = static_cast<std::uint32_t>(batch.positions.size());
  batch.positions.push_back(glm::vec3(center));
  batch.normals.push_back(norm > 1e-6 ? glm::vec3(normal / norm) : batch.normals[loop[0]]);
  return number;
}

}  // namespace

std::optional<std::size_t> hubOf(const ContourLoop& loop) {
  for (std::size_t vertex = 0; vertex < loop.faces.size(); ++vertex)
    if (seesAll(loop.faces, vertex)) return vertex;
  return std::nullopt;
}

void addFan(const WorldFrame& frame, const ContourLoop& loop, std::size_t hub, MeshBatch& batch) {
  const std::span<const std::uint32_t> vertices = loop.vertices;
  const std::size_t size = vertices.size();
  for (std::size_t step = 1; step + 1 < size; ++step)
    addTriangle(frame, vertices[hub], vertices[(hub + step) % size],
                vertices[(hub + step + 1) % size], batch);
}

void addCenteredFan(const WorldFrame& frame, const glm::dvec3& cell_center, const ContourLoop& loop,
                    MeshBatch& batch) {
  const std::span<const std::uint32_t> vertices = loop.vertices;
  const std::uint32_t center = addCenter(cell_center, vertices, batch);
  for (std::size_t i = 0; i < vertices.size(); ++i)
    addTriangle(frame, center, vertices[i], vertices[(i + 1) % vertices.size()], batch);
}

}  // namespace isobrick
