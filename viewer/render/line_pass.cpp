#include "isobrick/viewer/render/line_pass.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <glm/vec2.hpp>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {

namespace {

constexpr glm::vec3 kFocusColor{1.0f, 0.93f, 0.62f};
constexpr float kFocusLineHalfWidth = 0.9f;  // pixels
constexpr glm::vec3 kSegmentColor{0.62f, 0.66f, 0.72f};
constexpr float kSegmentHalfWidth = 0.5f;
constexpr double kLeastDistance = 1e-6;  // of segments from the eye, in units of `far`

// A segment as a ribbon: coordinates of the viewport, pixels from its middle, and depth. Empty if
// it is not ahead of the near plane.
void addRibbon(const SceneView& view, const SceneSegment& segment, std::vector<glm::vec4>& ribbon) {
  const SceneFrame& frame = view.frame;
  const DepthRange& range = view.range;
  const PlacedCamera& camera = frame.camera;
  struct End {
    glm::dvec3 arm;
    double distance;
  };
  const auto endOf = [&](const glm::dvec3& point) {
    const glm::dvec3 arm = point - camera.eye;
    return End{arm, glm::dot(arm, camera.forward)};
  };
  End a = endOf(segment.begin), b = endOf(segment.end);
  const double near =
      camera.orthographic ? range.near : std::max(range.near, kLeastDistance * range.far);
  if (a.distance < near && b.distance < near) return;
  const auto cut = [&](End& end, const End& other) {
    if (end.distance >= near) return;
    const double share = (near - end.distance) / (other.distance - end.distance);
    end.arm += share * (other.arm - end.arm);
    end.distance = near;
  };
  cut(a, b);
  cut(b, a);
  const glm::dvec2 half_size(0.5 * frame.width, 0.5 * frame.height);
  const auto pixelOf = [&](const End& end) {
    const double w = camera.orthographic ? 1.0 : end.distance;
    return half_size * glm::dvec2(glm::dot(end.arm, camera.right) / (w * camera.half_width),
                                  glm::dot(end.arm, camera.up) / (w * camera.half_height));
  };
  const glm::dvec2 p = pixelOf(a), q = pixelOf(b);
  const double length = glm::distance(p, q);
  if (!(length > 1e-6)) return;
  const double reach = kSegmentHalfWidth * frame.pixel_scale + kLineReach;
  const glm::dvec2 across = glm::dvec2(p.y - q.y, q.x - p.x) / length * reach;
  const auto corner = [&](const glm::dvec2& pixel, const End& end, double side) {
    const glm::dvec2 place = view.inPort(pixel + side * across);
    return glm::vec4(glm::dvec4(place, side * reach, view.depth.depthAt(end.distance)));
  };
  for (const glm::vec4& place : {corner(p, a, -1), corner(q, b, -1), corner(q, b, 1),
                                 corner(p, a, -1), corner(q, b, 1), corner(p, a, 1)})
    ribbon.push_back(place);
}

// The outline of a sphere as a ribbon of triangles (3 corners each) that reaches `reach` pixels to
// both sides of the line: x and y in normalised device coordinates, and z the distance from the
// line's middle in pixels. The part behind the eye is left out. Empty if the eye is inside the
// sphere or the radius is not positive. The picture is width x height pixels.
std::vector<glm::vec3> outlineRibbon(const SphereOutline& sphere, const PlacedCamera& camera,
                                     int width, int height, double reach) {
  const glm::dvec3 to_center = sphere.center - camera.eye;
  const double distance = glm::length(to_center);
  const double r = sphere.radius;
  if (!(r > 0.0) || !(camera.orthographic || distance > r)) return {};

  // The rays that graze the sphere touch it along a circle, nearer than the centre and smaller than
  // the sphere.
  const bool parallel = camera.orthographic;  // then the rays touch it along a great circle
  const glm::dvec3 axis = parallel ? camera.forward : to_center / distance;
  const glm::dvec3 middle = parallel ? to_center : to_center - axis * (r * r / distance);
  const double circle_radius = parallel ? r : r * std::sqrt(1.0 - (r / distance) * (r / distance));
  const glm::dvec3 helper = std::abs(glm::dot(axis, camera.up)) < 0.9 ? camera.up : camera.right;
  const glm::dvec3 u = glm::normalize(glm::cross(axis, helper));
  const glm::dvec3 v = glm::cross(axis, u);

  struct Point {
    glm::dvec2 pixel;
    glm::dvec2 across;  // unit, in pixels
    bool ahead;
  };
  constexpr int kSegments = 360;
  std::array<Point, kSegments> points;
  const glm::dvec2 half_size(0.5 * width, 0.5 * height);
  const auto toPixel = [&](const glm::dvec3& arm) {
    const double depth = parallel ? 1.0 : glm::dot(arm, camera.forward);
    return half_size * glm::dvec2(glm::dot(arm, camera.right) / (depth * camera.half_width),
                                  glm::dot(arm, camera.up) / (depth * camera.half_height));
  };
  for (int i = 0; i < kSegments; ++i) {
    const double angle = glm::radians(360.0 * i / kSegments);
    const glm::dvec3 radial = u * std::cos(angle) + v * std::sin(angle);
    const glm::dvec3 tangent = v * std::cos(angle) - u * std::sin(angle);
    const glm::dvec3 arm = middle + circle_radius * radial;
    Point& point = points[static_cast<std::size_t>(i)];
    point.ahead = parallel || glm::dot(arm, camera.forward) > 1e-3 * distance;
    if (!point.ahead) continue;
    point.pixel = toPixel(arm);
    const glm::dvec2 along = toPixel(arm + 1e-4 * circle_radius * tangent) - point.pixel;
    point.across = glm::normalize(glm::dvec2(-along.y, along.x));
  }

  std::vector<glm::vec3> ribbon;
  const auto corner = [&](const Point& point, double side) {
    return glm::vec3(glm::vec2((point.pixel + side * reach * point.across) / half_size),
                     side * reach);
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Point& a = points[i];
    const Point& b = points[(i + 1) % points.size()];
    if (!a.ahead || !b.ahead) continue;
    for (const glm::vec3& place : {corner(a, -1.0), corner(b, -1.0), corner(b, 1.0),
                                   corner(a, -1.0), corner(b, 1.0), corner(a, 1.0)}) {
      ribbon.push_back(place);
    }
  }
  return ribbon;
}

}  // namespace

LinePass::LinePass()
    : line_program_(makeLineProgram()),
      sphere_program_(makeSphereProgram()),
      line_array_(GlVertexArray::make()),
      empty_array_(GlVertexArray::make()),
      line_buffer_(GlBuffer::make()) {
  glVertexArrayAttribFormat(*line_array_, 0, 4, GL_FLOAT, GL_FALSE, 0);
  glVertexArrayAttribBinding(*line_array_, 0, 0);
  glEnableVertexArrayAttrib(*line_array_, 0);
  glVertexArrayVertexBuffer(*line_array_, 0, *line_buffer_, 0, sizeof(glm::vec4));
}

void LinePass::drawSegments(const SceneView& view) const {
  std::vector<glm::vec4> ribbon;
  for (const SceneSegment& segment : view.frame.segments) addRibbon(view, segment, ribbon);
  view.useViewport();
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_FALSE);
  drawRibbon(ribbon, kSegmentColor, kSegmentHalfWidth * static_cast<float>(view.frame.pixel_scale),
             0.15f);
  glDepthMask(GL_TRUE);
}

void LinePass::drawSphere(const SceneView& view) const {
  const SceneFrame& frame = view.frame;
  if (!frame.sphere || !(frame.sphere->radius > 0.0)) return;
  // Seen from within it would tint all of the picture and show nothing.
  const bool is_within =
      !frame.camera.orthographic &&
      glm::distance(frame.camera.eye, frame.sphere->center) <= frame.sphere->radius;
  if (frame.fill_sphere && !is_within) {
    useProgram(sphere_program_, view);
    setUniform(sphere_program_, "center", view.eyePosition(frame.sphere->center));
    setUniform(sphere_program_, "radius", static_cast<float>(frame.sphere->radius));
    setUniform(sphere_program_, "color", linearColor(kFocusColor));
    glEnable(GL_DEPTH_TEST);
    glDepthMask(GL_FALSE);
    glEnable(GL_BLEND);
    glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    glBindVertexArray(*empty_array_);
    glDrawArrays(GL_TRIANGLES, 0, kSphereVertices);
    glDepthMask(GL_TRUE);
  }
  std::vector<glm::vec4> ribbon;
  const float half_width = kFocusLineHalfWidth * static_cast<float>(frame.pixel_scale);
  const glm::dvec2 half_size(0.5 * frame.width, 0.5 * frame.height);
  for (const glm::vec3& place : outlineRibbon(*frame.sphere, frame.camera, frame.width,
                                              frame.height, half_width + kLineReach))
    ribbon.emplace_back(view.inPort(half_size * glm::dvec2(place)), place.z, 0.0f);
  view.useViewport();
  glDisable(GL_DEPTH_TEST);
  drawRibbon(ribbon, kFocusColor, half_width, 0.5f);
}

void LinePass::drawRibbon(const std::vector<glm::vec4>& ribbon, const glm::vec3& color,
                          float half_width, float casing) const {
  if (ribbon.empty()) return;
  glEnable(GL_BLEND);
  glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  glUseProgram(*line_program_);
  setUniform(line_program_, "line_color", linearColor(color));
  setUniform(line_program_, "half_width", half_width);
  setUniform(line_program_, "casing", casing);
  glBindVertexArray(*line_array_);
  glNamedBufferData(*line_buffer_, static_cast<GLsizeiptr>(ribbon.size() * sizeof(glm::vec4)),
                    ribbon.data(), GL_STREAM_DRAW);
  glDrawArrays(GL_TRIANGLES, 0, static_cast<GLsizei>(ribbon.size()));
  glDisable(GL_BLEND);
}

}  // namespace isobrick
