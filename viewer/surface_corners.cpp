#include "isobrick/viewer/surface_corners.h"

#include <algorithm>
#include <cassert>
#include <glm/geometric.hpp>

namespace isobrick {
namespace {

std::array<std::int16_t, 3> packNormal(const glm::vec3& normal) {
  const auto pack = [](float value) {
    return static_cast<std::int16_t>(std::clamp(value, -1.0f, 1.0f) * 32767.0f);
  };
  return {pack(normal.x), pack(normal.y), pack(normal.z)};
}

}  // namespace

void fillCorners(const RenderMesh& mesh, std::size_t first_triangle, std::size_t count,
                 const glm::dvec3& eye, bool with_levels, SurfaceCorner* corners) {
  for (std::size_t t = first_triangle; t < first_triangle + count; ++t, corners += 3) {
    const std::uint16_t level = with_levels ? mesh.triangle_levels[t] : std::uint16_t{0};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t vertex = mesh.triangles[3 * t + k];
      assert(vertex < mesh.positions.size());
      corners[k].position_from_eye = glm::vec3(glm::dvec3(mesh.positions[vertex]) - eye);
      if (!mesh.normals.empty()) corners[k].normal = packNormal(mesh.normals[vertex]);
      corners[k].level = level;
    }
    if (mesh.normals.empty()) {
      const glm::vec3 facet =
          glm::cross(corners[1].position_from_eye - corners[0].position_from_eye,
                     corners[2].position_from_eye - corners[0].position_from_eye);
      const float area = glm::length(facet);
      const auto normal = packNormal(area > 0.0f ? facet / area : glm::vec3(0.0f));
      for (std::size_t k = 0; k < 3; ++k) corners[k].normal = normal;
    }
  }
}

}  // namespace isobrick
