// An extracted surface in the form in which pictures are drawn.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

#include "tools/query_options.h"

namespace isobrick {

struct PictureMesh {
  // World units relative to the volume's centre: far from the world's origin single precision would
  // not tell vertices apart, and a camera that frames the mesh does not see the difference.
  std::vector<glm::vec3> positions;
  std::vector<glm::vec3> normals;
  std::vector<std::uint32_t> triangles;
  std::vector<std::uint8_t> triangle_levels;

  // The sphere inside of which everything is of the finest level.
  struct Sphere {
    glm::dvec3 center{0.0};  // like positions
    double radius = 0;       // world units
  };
  std::optional<Sphere> focus;
};

PictureMesh extractPictureMesh(const QueryOptions& options);

}  // namespace isobrick
