#include "isobrick/viewer/render/scene_view.h"

#include <algorithm>
#include <bit>
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

namespace {

// Triangles are cut at a viewport, and their new corners rounded, so it is far larger than a tile.
constexpr unsigned kLeastPort = 8192;  // pixels

}  // namespace

SceneView::SceneView(const SceneFrame& f) : SceneView(f, PixelBox{0, 0, f.width, f.height}) {}

SceneView::SceneView(const SceneFrame& f, const PixelBox& box)
    : frame(f),
      drawn(box),
      port_middle(box.left + box.width / 2 - 0.5 * f.width,
                  firstPixel().y + box.height / 2 - 0.5 * f.height),
      half_port(static_cast<int>(std::max(kLeastPort, std::bit_ceil(static_cast<unsigned>(
                                                          std::max(box.width, box.height)))) /
                                 2)),
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

glm::ivec2 SceneView::firstPixel() const { return {drawn.left, frame.height - drawn.bottom()}; }

glm::dvec2 SceneView::inPort(const glm::dvec2& pixel) const {
  return (glm::round(pixel * 256.0) / 256.0 - port_middle) / static_cast<double>(half_port);
}

void SceneView::useViewport() const {
  glViewport(drawn.width / 2 - half_port, drawn.height / 2 - half_port, 2 * half_port,
             2 * half_port);
}

LatticePlanes SceneView::planesOfRows(int begin, int end) const {
  const PlacedCamera& camera = frame.camera;
  LatticePlanes planes;
  for (const SceneClipPlane& plane : frame.clip_planes) planes.push_back(inLattice(plane));
  // Perspective: half * ahead >= to the side. Orthographic: half >= to the side.
  const auto addSide = [&](const glm::dvec3& side, double half) {
    const glm::dvec3 normal = camera.orthographic ? -side : half * camera.forward - side;
    const double through_eye = glm::dot(normal, camera.eye);
    planes.push_back(inLattice({normal, through_eye - (camera.orthographic ? half : 0.0)}));
  };
  // A pixel more, as places are rounded.
  const glm::dvec2 size(frame.width, frame.height), half(camera.half_width, camera.half_height);
  const glm::dvec2 first = firstPixel() + glm::ivec2(0, begin);
  const glm::dvec2 lower = half * (2.0 * (first - 1.0) / size - 1.0);
  const glm::dvec2 upper =
      half * (2.0 * (first + glm::dvec2(drawn.width, end - begin) + 1.0) / size - 1.0);
  addSide(camera.right, upper.x);
  addSide(-camera.right, -lower.x);
  addSide(camera.up, upper.y);
  addSide(-camera.up, -lower.y);
  return planes;
}

void BufferBox::include(const BufferBox& other) {
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

BufferBox SceneView::pixelsOf(std::span<const glm::dvec3> hull) const {
  constexpr double kMargin = 1.0;  // shaders round
  const PlacedCamera& camera = frame.camera;
  glm::dvec2 lower(std::numeric_limits<double>::infinity()), upper = -lower;
  for (const glm::dvec3& point : hull) {
    const glm::dvec3 arm = point - camera.eye;
    const double distance = camera.orthographic ? 1.0 : glm::dot(arm, camera.forward);
    // Beside or behind the eye a point is anywhere.
    if (!(distance > 1e-6 * range.far)) return {0, 0, drawn.width, drawn.height};
    const glm::dvec2 place = glm::dvec2(glm::dot(arm, camera.right) / camera.half_width,
                                        glm::dot(arm, camera.up) / camera.half_height) /
                             distance;
    lower = glm::min(lower, place);
    upper = glm::max(upper, place);
  }
  const glm::dvec2 size(frame.width, frame.height), first(firstPixel());
  const glm::dvec2 begin = 0.5 * (lower + 1.0) * size - first - kMargin;
  const glm::dvec2 end = 0.5 * (upper + 1.0) * size - first + 1.0 + kMargin;
  const auto pixel = [](double place, int most) {
    return static_cast<int>(std::clamp(place, 0.0, static_cast<double>(most)));
  };
  return {pixel(begin.x, drawn.width), pixel(begin.y, drawn.height), pixel(end.x, drawn.width),
          pixel(end.y, drawn.height)};
}

void useProgram(const GlProgram& program, const SceneView& view, int uncut_plane) {
  glUseProgram(*program);
  view.useViewport();
  setUniform(program, "half_picture", 0.5f * glm::vec2(view.frame.width, view.frame.height));
  setUniform(program, "port_middle", glm::vec2(view.port_middle));
  setUniform(program, "half_port", static_cast<float>(view.half_port));
  setUniform(program, "projection", view.projection);
  setUniform(program, "orthographic", static_cast<int>(view.frame.camera.orthographic));
  setUniform(program, "clip_count", static_cast<int>(view.clip_planes.size()));
  for (std::size_t i = 0; i < view.clip_planes.size(); ++i) {
    const std::string name = "clip_planes[" + std::to_string(i) + "]";
    const bool cuts = static_cast<int>(i) != uncut_plane;
    setUniform(program, name.c_str(), cuts ? view.clip_planes[i] : glm::vec4(0, 0, 0, 1));
  }
}

void setPlacesOfPixels(const GlProgram& program, const SceneView& view) {
  glUseProgram(*program);
  glViewport(0, 0, view.drawn.width, view.drawn.height);
  setUniform(program, "projection", view.projection);
  setUniform(program, "orthographic", static_cast<int>(view.frame.camera.orthographic));
  setUniform(program, "first_pixel", view.firstPixel());
  setUniform(program, "picture_size", glm::vec2(view.frame.width, view.frame.height));
}

glm::vec3 linearColor(const glm::vec3& srgb) {
  return {linearFromSrgb(srgb.r), linearFromSrgb(srgb.g), linearFromSrgb(srgb.b)};
}

}  // namespace isobrick
