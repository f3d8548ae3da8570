// The place of the eye, its view, and depth from distance: arithmetic without OpenGL.
#pragma once

#include <array>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

namespace isobrick {

// In double precision, and meshes are sent relative to the eye: a scanner's origin can be far away
// compared with a voxel.
struct PlacedCamera {
  glm::dvec3 eye{0.0};
  glm::dvec3 right{1.0, 0.0, 0.0};  // right, up and forward are orthonormal
  glm::dvec3 up{0.0, 0.0, 1.0};
  glm::dvec3 forward{0.0, 1.0, 0.0};
  double half_width = 1.0;    // of the picture: at distance 1, or in world units if orthographic
  double half_height = 1.0;   // likewise
  bool orthographic = false;  // all rays are parallel; points behind the eye are seen too

  bool operator==(const PlacedCamera&) const = default;
};

// An axis-aligned box of the world; empty if a lower bound exceeds the upper.
struct WorldBox {
  glm::dvec3 lower{0.0};
  glm::dvec3 upper{0.0};

  bool empty() const { return !(lower.x <= upper.x && lower.y <= upper.y && lower.z <= upper.z); }
  glm::dvec3 center() const { return 0.5 * (lower + upper); }
  void include(const glm::dvec3& point);
  bool operator==(const WorldBox&) const = default;
};

// A box that holds nothing, to include points in.
WorldBox emptyWorldBox();
std::array<glm::dvec3, 8> cornersOf(const WorldBox& box);

// Clip planes that just hold the box, for the sake of depth resolution. For perspective `near` is
// kept above 0 if the eye is inside the box or the box behind it.
struct DepthRange {
  double near = 0.1;
  double far = 1.0;
};
DepthRange depthRangeOf(const WorldBox& box, const PlacedCamera& camera);

// Reversed depth: 1 at `near` and 0 at `far`, where floats are densest. For a point at distance d
// along the camera's forward axis, depth = (offset - scale * d) / w with w = d for perspective and
// w = 1 for orthographic pictures.
struct DepthProjection {
  double scale = 0.0;
  double offset = 0.0;
  bool orthographic = false;

  double depthAt(double distance) const {
    return (offset - scale * distance) / (orthographic ? 1.0 : distance);
  }
  double distanceAt(double depth) const {
    return orthographic ? (offset - depth) / scale : offset / (depth + scale);
  }
};
DepthProjection reversedDepth(const DepthRange& range, bool orthographic);

// A ray of a picture. `place` is in normalised device coordinates: -1 .. 1, +x right, +y up.
// `direction` advances by 1 along the camera's forward axis.
struct PictureRay {
  glm::dvec3 origin{0.0};
  glm::dvec3 direction{0.0, 1.0, 0.0};

  glm::dvec3 at(double distance) const { return origin + distance * direction; }
};
PictureRay rayThrough(const PlacedCamera& camera, const glm::dvec2& place);

}  // namespace isobrick
