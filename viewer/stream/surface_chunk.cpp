#include "isobrick/viewer/stream/surface_chunk.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/matrix.hpp>

#include "isobrick/extract/color_map.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {
namespace {

constexpr float kPackedUnit = 32767.0f;  // 1 of a normal

}  // namespace

std::array<std::int16_t, 3> packNormal(const glm::vec3& normal) {
  const auto pack = [](float value) {
    return static_cast<std::int16_t>(std::clamp(value, -1.0f, 1.0f) * kPackedUnit);
  };
  return {pack(normal.x), pack(normal.y), pack(normal.z)};
}

glm::vec3 unpackNormal(const std::array<std::int16_t, 3>& packed) {
  return glm::vec3(packed[0], packed[1], packed[2]) / kPackedUnit;
}

std::int16_t packValue(double share) {
  if (std::isnan(share)) return kNoVertexValue;
  return static_cast<std::int16_t>(std::lround(std::clamp(share, 0.0, 1.0) * 65533.0) - 32766);
}

std::int16_t packComponent(std::uint32_t number) {
  if (number == kNoComponent) return kNoVertexValue;
  return static_cast<std::int16_t>(number % kComponentColorCount);
}

void boundChunk(SurfaceChunk& chunk) {
  chunk.lower = chunk.upper = chunk.vertices.empty() ? glm::vec3(0.0f) : chunk.vertices[0].position;
  for (const SurfaceVertex& vertex : chunk.vertices) {
    chunk.lower = glm::min(chunk.lower, vertex.position);
    chunk.upper = glm::max(chunk.upper, vertex.position);
  }
}

glm::dvec3 SceneLattice::toLattice(const glm::dvec3& world) const {
  return glm::inverse(matrix) * (world - origin);
}

SnappedEye snapEye(const glm::dvec3& eye, double reach) {
  // Differences of whole numbers and multiples of `step`, below 2^23 steps, are floats. Steps above
  // 1 would not divide whole numbers; so far out a rounded offset moves the picture by nothing.
  int exponent = 0;
  std::frexp(std::max(reach, 1.0), &exponent);  // reach < 2^exponent
  const double step = std::min(1.0, std::ldexp(1.0, exponent - 23));
  const glm::dvec3 snapped = glm::round(eye / step) * step;
  return {snapped, eye - snapped};
}

}  // namespace isobrick
