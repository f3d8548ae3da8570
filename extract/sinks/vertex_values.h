// A value for every vertex of a mesh, beside its position and its normal.
#pragma once

#include <glm/vec3.hpp>
#include <span>

namespace isobrick {

// A field in the world. Thread-safe.
class VertexValues {
 public:
  virtual ~VertexValues() = default;
  // Fills `values`, one for every position; not a number where the field has none. What it throws
  // ends the extraction.
  virtual void evaluate(std::span<const glm::dvec3> world, std::span<float> values) const = 0;
};

}  // namespace isobrick
