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

// A field in the world, or a measure of how a surface lies in it. Thread-safe.
class VertexValues {
 public:
  virtual ~VertexValues() = default;
  // Fills `values`, one for every vertex, whose positions are world units and whose normals are
  // unit vectors that point outward; as many of each. NaN if a vertex has no value. An exception
  // ends the extraction.
  virtual void evaluate(std::span<const glm::dvec3> world, std::span<const glm::vec3> normals,
                        std::span<double> values) const = 0;
};

// How the numbers of vertices are stored. A float holds whole numbers up to 16,777,216, a double
// up to 2^53.
enum class AttributeType { kFloat32, kFloat64, kInt32, kUint32 };

// How values between samples are found.
enum class Sampling {
  kTrilinear,  // from the eight samples around the place
  kNearest,    // the sample that is nearest in voxel indices: labels, which have no mean
};

// Samples level 0. Within half a voxel outside of the outermost samples, the end of their voxels,
// the value is that of the border; further out there is none (NaN). Normals do not count. Holds one
// brick for each thread that evaluates. The pyramid outlives it.
class PyramidValues : public VertexValues {
 public:
  // Reads nothing yet.
  explicit PyramidValues(const Pyramid& pyramid, Sampling sampling = Sampling::kTrilinear);

  // Throws Error, with the path and the brick, if samples cannot be read.
  void evaluate(std::span<const glm::dvec3> world, std::span<const glm::vec3> normals,
                std::span<double> values) const override;
  // Positions so far that had no value.
  std::uint64_t outside() const { return outside_; }

 private:
  const Pyramid& pyramid_;
  const Sampling sampling_;
  glm::dvec3 origin_{0.0};
  glm::dmat3 world_to_index_{1.0};
  mutable std::atomic<std::uint64_t> outside_{0};
};

// How the labels of a pyramid are stored in a mesh file: as whole numbers if its samples are such,
// of 32 bits; else as float64.
AttributeType labelTypeOf(const Pyramid& pyramid);

}  // namespace isobrick
