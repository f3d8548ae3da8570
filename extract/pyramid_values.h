// A value for every vertex of a mesh, beside its position and its normal: for instance that of
// another pyramid.
#pragma once

#include <atomic>
#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <span>

#include "isobrick/storage/pyramid.h"

namespace isobrick {

// A field in the world. Thread-safe.
class VertexValues {
 public:
  virtual ~VertexValues() = default;
  // Fills `values`, one for every position; NaN if the field has none there. An
  // exception ends the extraction.
  virtual void evaluate(std::span<const glm::dvec3> world, std::span<float> values) const = 0;
};

// Interpolates the samples of level 0 trilinearly. Within half a voxel outside of the outermost
// samples, the end of their voxels, the value is that of the border; further out there is none
// (NaN). Holds one brick for each thread that evaluates. The pyramid outlives it.
class PyramidValues : public VertexValues {
 public:
  // Reads nothing yet.
  explicit PyramidValues(const Pyramid& pyramid);

  // Throws Error, with the path and the brick, if samples cannot be read.
  void evaluate(std::span<const glm::dvec3> world, std::span<float> values) const override;
  // Positions so far that had no value.
  std::uint64_t outside() const { return outside_; }

 private:
  const Pyramid& pyramid_;
  glm::dvec3 origin_{0.0};
  glm::dmat3 world_to_index_{1.0};
  mutable std::atomic<std::uint64_t> outside_{0};
};

}  // namespace isobrick
