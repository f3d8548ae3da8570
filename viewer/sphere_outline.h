// A sphere that is drawn as a circle.
#pragma once

#include <glm/vec3.hpp>

namespace isobrick {

// A sphere whose outline is a part of a picture.
struct SphereOutline {
  glm::dvec3 center{0.0};  // world units
  double radius = 0.0;     // world units, > 0

  bool operator==(const SphereOutline&) const = default;  // equal in all
};

}  // namespace isobrick
