#include "isobrick/viewer/render/scene_view.h"

#include <algorithm>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <glm/vec2.hpp>
#include <limits>
#include <string>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {

bool mayBeInside(const LatticePlanes& planes, const glm::dvec3& lower, const glm::dvec3& upper) {
  constexpr double kMargin = 1e-6;  // of the terms: shaders round them to floats
  for (const glm::dvec4& plane : planes) {
    double sum = plane.w, size = std::abs(plane.w);
    for (glm::length_t axis = 0; axis < 3; ++axis) {
      const double term = plane[axis] * (plane[axis] > 0.0 ? upper : lower)[axis];
      sum += term;
      size += std::abs(term);
    }
    if (sum < -kMargin * size) return false;
  }
  return true;
}

SceneView::SceneView(const SceneFrame& f)
    : frame(f),
      range(depthRangeOf(f.bounds, f.camera)),
      depth(reversedDepth(range, f.camera.orthographic)),
      to_eye(glm::transpose(glm::dmat3(f.camera.right, f.camera.up, -f.camera.forward))),
      projection(1.0 / f.camera.half_width, 1.0 / f.camera.half_height, depth.scale, depth.offset) {
  const glm::dvec3 eye = f.lattice.toLattice(f.camera.eye);
  double reach = 1.0;
  if (!f.bounds.empty())
    for (const glm::dvec3& corner : cornersOf(f.bounds))
      reach = std::max(reach, glm::distance(f.lattice.toLattice(corner), eye));
  snapped = snapEye(eye, reach);
  for (const SceneClipPlane& plane : f.clip_planes) clip_planes.push_back(planeSeen(plane));
}

glm::vec4 SceneView::planeSeen(const SceneClipPlane& plane) const {
  return glm::vec4(
      glm::dvec4(to_eye * plane.normal, glm::dot(plane.normal, frame.camera.eye) - plane.offset));
}

glm::dvec4 SceneView::inLattice(const SceneClipPlane& plane) const {
  return {glm::transpose(frame.lattice.matrix) * plane.normal,
          glm::dot(plane.normal, frame.lattice.origin) - plane.offset};
}

LatticePlanes SceneView::planesOfRows(int begin, int end) const {
  const PlacedCamera& camera = frame.camera;
  LatticePlanes planes;
  for (const SceneClipPlane& plane : frame.clip_planes) planes.push_back(inLattice(plane));
  // Perspective: half_width * ahead >= to the side. Orthographic: half_width >= to the side.
  const auto addSide = [&](const glm::dvec3& side, double half) {
    const glm::dvec3 normal = camera.orthographic ? -side : half * camera.forward - side;
    const double through_eye = glm::dot(normal, camera.eye);
    planes.push_back(inLattice({normal, through_eye - (camera.orthographic ? half : 0.0)}));
  };
  addSide(camera.right, camera.half_width);
  addSide(-camera.right, camera.half_width);
  const auto heightAt = [&](int row) {
    return camera.half_height * (2.0 * row / frame.height - 1.0);
  };
  addSide(camera.up, heightAt(end));
  addSide(-camera.up, -heightAt(begin));
  return planes;
}

void PixelBox::include(const PixelBox& other) {
  if (other.isEmpty()) return;
  if (isEmpty()) {
    *this = other;
    return;
  }
  left = std::min(left, other.left);
  bottom = std::min(bottom, other.bottom);
  right = std::max(right, other.right);
  top = std::max(top, other.top);
}

PixelBox SceneView::pixelsOf(std::span<const glm::dvec3> hull) const {
  constexpr double kMargin = 1.0;  // shaders round
  const PlacedCamera& camera = frame.camera;
  glm::dvec2 lower(std::numeric_limits<double>::infinity()), upper = -lower;
  for (const glm::dvec3& point : hull) {
    const glm::dvec3 arm = point - camera.eye;
    const double distance = camera.orthographic ? 1.0 : glm::dot(arm, camera.forward);
    // Beside or behind the eye a point is anywhere.
    if (!(distance > 1e-6 * range.far)) return {0, 0, frame.width, frame.height};
    const glm::dvec2 place = glm::dvec2(glm::dot(arm, camera.right) / camera.half_width,
                                        glm::dot(arm, camera.up) / camera.half_height) /
                             distance;
    lower = glm::min(lower, place);
    upper = glm::max(upper, place);
  }
  const auto pixel = [](double place, int size, double margin) {
    return static_cast<int>(
        std::clamp(0.5 * (place + 1.0) * size + margin, 0.0, static_cast<double>(size)));
  };
  return {pixel(lower.x, frame.width, -kMargin), pixel(lower.y, frame.height, -kMargin),
          pixel(upper.x, frame.width, 1.0 + kMargin), pixel(upper.y, frame.height, 1.0 + kMargin)};
}

void useProgram(const GlProgram& program, const SceneView& view, int uncut_plane) {
  glUseProgram(*program);
  setUniform(program, "projection", view.projection);
  setUniform(program, "orthographic", static_cast<int>(view.frame.camera.orthographic));
  setUniform(program, "clip_count", static_cast<int>(view.clip_planes.size()));
  for (std::size_t i = 0; i < view.clip_planes.size(); ++i) {
    const std::string name = "clip_planes[" + std::to_string(i) + "]";
    const bool cuts = static_cast<int>(i) != uncut_plane;
    setUniform(program, name.c_str(), cuts ? view.clip_planes[i] : glm::vec4(0, 0, 0, 1));
  }
}

glm::vec3 linearColor(const glm::vec3& srgb) {
  return {linearFromSrgb(srgb.r), linearFromSrgb(srgb.g), linearFromSrgb(srgb.b)};
}

}  // namespace isobrick
