#include "viewer/offscreen_renderer.h"

#include <dlfcn.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/trigonometric.hpp>
#include <glm/vec2.hpp>
#include <limits>
#include <vector>

#include "storage/error.h"

namespace isobrick {
namespace {

// ---------------------------------------------------------------------------------------- colours

// Ordered by hue, in steps that stay apart for colour-blind eyes by their lightness as well.
constexpr std::array<glm::vec3, 8> kLevelColors{{
    {0.84f, 0.24f, 0.27f},  // red
    {0.96f, 0.55f, 0.25f},  // orange
    {0.97f, 0.84f, 0.42f},  // yellow
    {0.58f, 0.77f, 0.40f},  // green
    {0.24f, 0.66f, 0.62f},  // teal
    {0.24f, 0.51f, 0.80f},  // blue
    {0.38f, 0.34f, 0.70f},  // indigo
    {0.60f, 0.38f, 0.64f},  // violet
}};

glm::vec3 linearColor(const glm::vec3& srgb) {
  return {linearFromSrgb(srgb.r), linearFromSrgb(srgb.g), linearFromSrgb(srgb.b)};
}

// ---------------------------------------------------------------------------------------- shaders

// Eye coordinates: the eye at the origin, +x right, +y up, -z ahead. All light is linear.
constexpr char kSurfaceVertexShader[] = R"(#version 330 core
layout(location = 0) in vec3 position_from_eye;
layout(location = 1) in vec3 normal;
layout(location = 2) in uint level;
uniform mat3 world_to_eye;
uniform vec4 projection;  // x and y scale, depth scale and offset
out vec3 eye_position;
out vec3 eye_normal;
out vec3 barycentric;
flat out uint triangle_level;

void main() {
  eye_position = world_to_eye * position_from_eye;
  eye_normal = world_to_eye * normal;
  int corner = gl_VertexID % 3;
  barycentric = vec3(corner == 0, corner == 1, corner == 2);
  triangle_level = level;
  gl_Position = vec4(projection.xy * eye_position.xy, projection.z * eye_position.z + projection.w,
                     -eye_position.z);
}
)";

constexpr char kSurfaceFragmentShader[] = R"(#version 330 core
in vec3 eye_position;
in vec3 eye_normal;
in vec3 barycentric;
flat in uint triangle_level;
uniform vec3 level_colors[8];
uniform vec3 back_color;
uniform bool wireframe;
out vec4 color;

const vec3 kKeyDirection = normalize(vec3(-0.55, 0.75, 0.60));  // over the viewer's left shoulder
const vec3 kSkyLight = vec3(0.20, 0.22, 0.25);
const vec3 kGroundLight = vec3(0.09, 0.08, 0.07);

// 1 on an edge of the triangle and 0 away from it, with a soft flank of one pixel.
float edgeCoverage() {
  vec3 step_x = dFdx(barycentric), step_y = dFdy(barycentric);
  // A barycentric coordinate grows from 0 to 1 over the triangle's height, so the length of its
  // gradient is 1 / height in pixels, and dividing by it gives the distance to the edge in pixels.
  vec3 per_pixel = max(sqrt(step_x * step_x + step_y * step_y), 1e-6);
  vec3 distances = barycentric / per_pixel;
  float nearest = min(distances.x, min(distances.y, distances.z));
  float least_height = 1.0 / max(per_pixel.x, max(per_pixel.y, per_pixel.z));
  float fade = clamp((least_height - 0.5) / 7.0, 0.12, 1.0);
  return fade * clamp(1.1 - nearest, 0.0, 1.0);
}

void main() {
  vec3 to_eye = normalize(-eye_position);
  float length_of_normal = length(eye_normal);
  vec3 normal = length_of_normal > 1e-6 ? eye_normal / length_of_normal : to_eye;
  // Back faces are lit as seen, whichever way their normals point; front faces with inward normals
  // stay dark, and are found out.
  if (!gl_FrontFacing && dot(normal, to_eye) < 0.0) normal = -normal;

  vec3 surface = gl_FrontFacing ? level_colors[min(triangle_level, 7u)] : back_color;
  float head = max(dot(normal, to_eye), 0.0);
  float key = max(dot(normal, kKeyDirection), 0.0);
  vec3 light = mix(kGroundLight, kSkyLight, 0.5 + 0.5 * normal.y) + 0.24 * head +
               vec3(0.70, 0.68, 0.64) * key;
  vec3 shaded = surface * light;
  if (gl_FrontFacing) {
    float gloss = pow(max(dot(normal, normalize(kKeyDirection + to_eye)), 0.0), 48.0);
    shaded += 0.10 * gloss * key;
  } else {
    shaded *= 0.6;
  }
  if (wireframe) shaded = mix(shaded, 0.10 * surface, 0.85 * edgeCoverage());
  color = vec4(shaded, 1.0);
}
)";

// One triangle that covers the picture.
constexpr char kBackgroundVertexShader[] = R"(#version 330 core
out float height;

void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  height = 0.5 + 0.5 * corner.y;
  gl_Position = vec4(corner, 0.0, 1.0);
}
)";

constexpr char kBackgroundFragmentShader[] = R"(#version 330 core
in float height;
uniform vec3 top;
uniform vec3 bottom;
out vec4 color;

void main() {
  vec3 root = mix(sqrt(bottom), sqrt(top), height);  // close to steps that look even
  color = vec4(root * root, 1.0);
}
)";

constexpr char kLineVertexShader[] = R"(#version 330 core
layout(location = 0) in vec3 place;  // normalised device coordinates, and pixels from the middle
out float pixels_from_middle;

void main() {
  pixels_from_middle = place.z;
  gl_Position = vec4(place.xy, 0.0, 1.0);
}
)";

constexpr char kLineFragmentShader[] = R"(#version 330 core
in float pixels_from_middle;
uniform vec3 line_color;
uniform float half_width;
out vec4 color;

void main() {
  float outside = abs(pixels_from_middle) - half_width;
  float line = clamp(0.5 - outside, 0.0, 1.0);
  float casing = 0.5 * clamp(2.0 - outside, 0.0, 1.0);  // dark, so that bright grounds show it too
  color = vec4(line_color * line, 1.0 - (1.0 - line) * (1.0 - casing));  // premultiplied
}
)";

constexpr glm::vec3 kFocusColor{1.0f, 0.93f, 0.62f};
constexpr float kFocusLineHalfWidth = 0.9f;  // pixels

GLuint compileShader(GLenum stage, const char* source) {
  const GLuint shader = glCreateShader(stage);
  glShaderSource(shader, 1, &source, nullptr);
  glCompileShader(shader);
  return shader;
}

GLuint linkProgram(const char* vertex_source, const char* fragment_source) {
  const GLuint vertex = compileShader(GL_VERTEX_SHADER, vertex_source);
  const GLuint fragment = compileShader(GL_FRAGMENT_SHADER, fragment_source);
  const GLuint program = glCreateProgram();
  glAttachShader(program, vertex);
  glAttachShader(program, fragment);
  glLinkProgram(program);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
  GLint linked = GL_FALSE;
  glGetProgramiv(program, GL_LINK_STATUS, &linked);
  if (linked != GL_TRUE) {
    std::array<char, 512> log{};
    glGetProgramInfoLog(program, static_cast<GLsizei>(log.size()), nullptr, log.data());
    std::replace(log.begin(), log.end(), '\n', ' ');
    throw Error(std::string("cannot render: the OpenGL driver refused a shader (") + log.data() +
                "); update the graphics driver or Mesa");
  }
  return program;
}

void setUniform(GLuint program, const char* name, const glm::vec3& value) {
  glUniform3fv(glGetUniformLocation(program, name), 1, &value[0]);
}

// ----------------------------------------------------------------------------------------- camera

RenderBox boundsOf(std::span<const glm::vec3> positions) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  RenderBox box{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  for (const glm::vec3& position : positions) {
    box.lower = glm::min(box.lower, position);
    box.upper = glm::max(box.upper, position);
  }
  return box;
}

bool isEmpty(const RenderBox& box) {
  return !(box.lower.x <= box.upper.x && box.lower.y <= box.upper.y && box.lower.z <= box.upper.z);
}

std::array<glm::dvec3, 8> cornersOf(const RenderBox& box) {
  std::array<glm::dvec3, 8> corners;
  for (unsigned i = 0; i < corners.size(); ++i) {
    corners[i] = {i & 1u ? box.upper.x : box.lower.x, i & 2u ? box.upper.y : box.lower.y,
                  i & 4u ? box.upper.z : box.lower.z};
  }
  return corners;
}

// In double precision, and the mesh is sent relative to the eye: a scanner's origin can be far away
// compared with a voxel.
struct PlacedCamera {
  glm::dvec3 eye{0.0};
  glm::dvec3 right{1.0, 0.0, 0.0};  // right, up and forward are orthonormal
  glm::dvec3 up{0.0, 0.0, 1.0};
  glm::dvec3 forward{0.0, 1.0, 0.0};
  double half_width = 1.0;   // of the picture at distance 1
  double half_height = 1.0;  // likewise
};

void placeLookAt(const LookAtCamera& look_at, PlacedCamera& camera) {
  camera.eye = look_at.eye;
  camera.forward = glm::normalize(look_at.target - look_at.eye);
  const glm::dvec3 right = glm::cross(camera.forward, glm::normalize(look_at.up));
  constexpr double kLeastSine = 1e-6;  // of the angle between up and the view
  if (!(glm::length(right) > kLeastSine) || !std::isfinite(glm::length(look_at.eye))) {
    throw Error(
        "cannot render: the camera's eye and target coincide or its up direction is parallel to "
        "the view; move the eye or choose another up direction");
  }
  camera.right = glm::normalize(right);
  camera.up = glm::cross(camera.right, camera.forward);
}

void turnOrbit(const OrbitCamera& orbit, PlacedCamera& camera) {
  const glm::dvec3 axis = glm::normalize(orbit.up);
  if (!std::isfinite(axis.x + axis.y + axis.z + orbit.azimuth + orbit.elevation)) {
    throw Error("cannot render: the camera's up direction is zero or an angle is not a number");
  }
  const bool axis_is_y = std::abs(axis.y) > 0.9;
  const glm::dvec3 ahead =
      axis_is_y ? glm::dvec3(0.0, 0.0, -std::copysign(1.0, axis.y)) : glm::dvec3(0.0, 1.0, 0.0);
  const glm::dvec3 front = glm::normalize(ahead - axis * glm::dot(ahead, axis));
  const glm::dvec3 side = glm::cross(front, axis);
  const double azimuth = glm::radians(orbit.azimuth);
  const double elevation = glm::radians(orbit.elevation);
  const glm::dvec3 outward = side * std::sin(azimuth) - front * std::cos(azimuth);
  // `up` is the derivative of the view by the elevation: defined even straight from above.
  camera.forward = -(outward * std::cos(elevation) + axis * std::sin(elevation));
  camera.up = axis * std::cos(elevation) - outward * std::sin(elevation);
  camera.right = glm::cross(camera.forward, camera.up);
}

// Moves the eye, without turning it, to where the points just fill the picture but for a margin:
// in the middle of both directions and touching the border in one.
template <typename Point>
void fitPoints(std::span<const Point> points, PlacedCamera& camera) {
  constexpr double kMargin = 1.06;
  const double half_width = camera.half_width / kMargin;
  const double half_height = camera.half_height / kMargin;
  // A point (x, y, z) along right, up and forward is left of the right border of an eye at (a, b,
  // c) where x - a <= half_width * (z - c); so only the greatest x - half_width * z of all points
  // matters there, and likewise at the three other borders.
  constexpr double kLeast = -std::numeric_limits<double>::infinity();
  double right = kLeast, left = kLeast, top = kLeast, bottom = kLeast, nearest = kLeast;
  for (const Point& point : points) {
    const glm::dvec3 p(point);
    const double x = glm::dot(p, camera.right);
    const double y = glm::dot(p, camera.up);
    const double z = glm::dot(p, camera.forward);
    right = std::max(right, x - half_width * z);
    left = std::max(left, -x - half_width * z);
    top = std::max(top, y - half_height * z);
    bottom = std::max(bottom, -y - half_height * z);
    nearest = std::max(nearest, -z);
  }
  double depth =
      std::min(-(right + left) / (2.0 * half_width), -(top + bottom) / (2.0 * half_height));
  // A point, or a line seen end on, can be approached without end.
  const double scale = std::max({1.0, std::abs(nearest), std::abs(right), std::abs(top)});
  if (-nearest - depth < 1e-9 * scale) depth = -nearest - 1.0;
  camera.eye = camera.right * (0.5 * (right - left)) + camera.up * (0.5 * (top - bottom)) +
               camera.forward * depth;
}

PlacedCamera placeCamera(const RenderOptions& options, const RenderMesh& mesh) {
  PlacedCamera camera;
  camera.half_height = std::tan(0.5 * glm::radians(options.vertical_fov));
  camera.half_width = camera.half_height * options.width / options.height;
  if (options.look_at) {
    placeLookAt(*options.look_at, camera);
    return camera;
  }
  turnOrbit(options.orbit, camera);
  if (options.orbit.box && !isEmpty(*options.orbit.box)) {
    const std::array<glm::dvec3, 8> corners = cornersOf(*options.orbit.box);
    fitPoints(std::span<const glm::dvec3>(corners), camera);
  } else if (!mesh.positions.empty()) {
    fitPoints(mesh.positions, camera);
  }
  return camera;
}

// Clip planes that just hold the box, for the sake of depth resolution; `near` is kept away from 0
// where the eye is inside the box or the box behind it.
struct DepthRange {
  double near = 0.1;
  double far = 1.0;
};

DepthRange depthRangeOf(const RenderBox& box, const PlacedCamera& camera) {
  if (isEmpty(box)) return {};
  double least = std::numeric_limits<double>::infinity();
  double greatest = -least;
  for (const glm::dvec3& corner : cornersOf(box)) {
    const double depth = glm::dot(corner - camera.eye, camera.forward);
    least = std::min(least, depth);
    greatest = std::max(greatest, depth);
  }
  if (greatest <= 0.0) return {};
  const double far = 1.001 * greatest;
  return {std::max(0.999 * least, 1e-4 * far), far};
}

// ------------------------------------------------------------------------------------- vertices

// A corner of a triangle. Triangles do not share them: that gives each corner its barycentric
// coordinate (from gl_VertexID) and each triangle its level, cuts meshes of any size into pieces
// with 32-bit counts, and costs little beside rasterising in software.
struct SurfaceCorner {
  glm::vec3 position_from_eye;
  std::array<std::int16_t, 3> normal;  // unit = 32767
  std::uint16_t level;
};
static_assert(sizeof(SurfaceCorner) == 20);

constexpr std::size_t kTrianglesPerPiece = std::size_t{1} << 18;  // 15 MiB of corners

std::array<std::int16_t, 3> packNormal(const glm::vec3& normal) {
  const auto pack = [](float value) {
    return static_cast<std::int16_t>(std::clamp(value, -1.0f, 1.0f) * 32767.0f);
  };
  return {pack(normal.x), pack(normal.y), pack(normal.z)};
}

void fillCorners(const RenderMesh& mesh, std::size_t first_triangle, std::size_t count,
                 const glm::dvec3& eye, bool with_levels, SurfaceCorner* corners) {
  for (std::size_t t = first_triangle; t < first_triangle + count; ++t, corners += 3) {
    const std::uint16_t level = with_levels ? mesh.triangle_levels[t] : std::uint16_t{0};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t vertex = mesh.triangles[3 * t + k];
      assert(vertex < mesh.positions.size());
      corners[k].position_from_eye = glm::vec3(glm::dvec3(mesh.positions[vertex]) - eye);
      if (!mesh.normals.empty()) corners[k].normal = packNormal(mesh.normals[vertex]);
      corners[k].level = level;
    }
    if (mesh.normals.empty()) {
      const glm::vec3 facet =
          glm::cross(corners[1].position_from_eye - corners[0].position_from_eye,
                     corners[2].position_from_eye - corners[0].position_from_eye);
      const float area = glm::length(facet);
      const auto normal = packNormal(area > 0.0f ? facet / area : glm::vec3(0.0f));
      for (std::size_t k = 0; k < 3; ++k) corners[k].normal = normal;
    }
  }
}

// The outline of a sphere as a ribbon of triangles: x and y in normalised device coordinates, and
// the distance from the line's middle in pixels. Empty where the eye is inside the sphere.
std::vector<glm::vec3> outlineRibbon(const SphereOutline& sphere, const PlacedCamera& camera,
                                     int width, int height) {
  const glm::dvec3 to_center = sphere.center - camera.eye;
  const double distance = glm::length(to_center);
  const double r = sphere.radius;
  if (!(r > 0.0) || !(distance > r)) return {};

  // The rays that graze the sphere touch it along a circle, nearer than the centre and smaller than
  // the sphere.
  const glm::dvec3 axis = to_center / distance;
  const glm::dvec3 middle = to_center - axis * (r * r / distance);
  const double circle_radius = r * std::sqrt(1.0 - (r / distance) * (r / distance));
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
    const double depth = glm::dot(arm, camera.forward);
    return half_size * glm::dvec2(glm::dot(arm, camera.right) / (depth * camera.half_width),
                                  glm::dot(arm, camera.up) / (depth * camera.half_height));
  };
  for (int i = 0; i < kSegments; ++i) {
    const double angle = glm::radians(360.0 * i / kSegments);
    const glm::dvec3 radial = u * std::cos(angle) + v * std::sin(angle);
    const glm::dvec3 tangent = v * std::cos(angle) - u * std::sin(angle);
    const glm::dvec3 arm = middle + circle_radius * radial;
    Point& point = points[static_cast<std::size_t>(i)];
    point.ahead = glm::dot(arm, camera.forward) > 1e-3 * distance;
    if (!point.ahead) continue;
    point.pixel = toPixel(arm);
    const glm::dvec2 along = toPixel(arm + 1e-4 * circle_radius * tangent) - point.pixel;
    point.across = glm::normalize(glm::dvec2(-along.y, along.x));
  }

  std::vector<glm::vec3> ribbon;
  const double reach = kFocusLineHalfWidth + 2.0;  // the line and its casing
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

// -------------------------------------------------------------------------------------------- EGL

constexpr char kInstallAdvice[] =
    "install an OpenGL 3.3 driver (Debian and Ubuntu: apt install libegl1 libopengl0 "
    "libgl1-mesa-dri)";

// libepoxy ends the process where a library is missing; an Error is friendlier. The libraries stay
// loaded: libepoxy loads them next.
void requireLibraries() {
  const auto loads = [](const char* name) {
    return dlopen(name, RTLD_LAZY | RTLD_LOCAL) != nullptr;
  };
  if (!loads("libEGL.so.1") || !(loads("libOpenGL.so.0") || loads("libGL.so.1"))) {
    throw Error(std::string("cannot render: libEGL.so.1 or libOpenGL.so.0 is not here; ") +
                kInstallAdvice);
  }
}

struct EglHandles {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLSurface surface = EGL_NO_SURFACE;
  EGLContext context = EGL_NO_CONTEXT;
};

// The handles stay empty where the display is of no use. A display belongs to the whole process and
// is never terminated: that would pull it from under other renderers.
EglHandles openOn(EGLDisplay display) {
  if (display == EGL_NO_DISPLAY || !eglInitialize(display, nullptr, nullptr)) return {};
  if (!eglBindAPI(EGL_OPENGL_API)) return {};
  const EGLint config_wishes[] = {EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE,
                                  EGL_OPENGL_BIT, EGL_NONE};
  EGLConfig config = nullptr;
  EGLint configs = 0;
  if (!eglChooseConfig(display, config_wishes, &config, 1, &configs) || configs < 1) return {};

  const EGLint context_wishes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                   3,
                                   EGL_CONTEXT_MINOR_VERSION,
                                   3,
                                   EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                   EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                   EGL_NONE};
  // Never drawn to; some drivers make no context current without a surface.
  const EGLint surface_wishes[] = {EGL_WIDTH, 1, EGL_HEIGHT, 1, EGL_NONE};
  EglHandles handles{display, eglCreatePbufferSurface(display, config, surface_wishes),
                     eglCreateContext(display, config, EGL_NO_CONTEXT, context_wishes)};
  if (handles.surface != EGL_NO_SURFACE && handles.context != EGL_NO_CONTEXT) return handles;
  if (handles.surface != EGL_NO_SURFACE) eglDestroySurface(display, handles.surface);
  if (handles.context != EGL_NO_CONTEXT) eglDestroyContext(display, handles.context);
  return {};
}

EglHandles openContext() {
  requireLibraries();
  EglHandles handles;
  if (epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_base") &&
      epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless")) {
    handles = openOn(
        eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr));
  }
  if (handles.context == EGL_NO_CONTEXT) handles = openOn(eglGetDisplay(EGL_DEFAULT_DISPLAY));
  if (handles.context == EGL_NO_CONTEXT) {
    throw Error(std::string("cannot render: EGL gives no OpenGL 3.3 context without a window; ") +
                kInstallAdvice);
  }
  return handles;
}

// Makes the context current on this thread, and none at the end, so that the next call may come
// from another thread. EGL keeps the bound API per thread.
class CurrentScope {
 public:
  explicit CurrentScope(const EglHandles& handles) : display_(handles.display) {
    eglBindAPI(EGL_OPENGL_API);
    if (!eglMakeCurrent(display_, handles.surface, handles.surface, handles.context)) {
      throw Error(
          "cannot render: EGL could not make its context current; is the renderer in use on "
          "another thread?");
    }
  }
  ~CurrentScope() { eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT); }
  CurrentScope(const CurrentScope&) = delete;
  CurrentScope& operator=(const CurrentScope&) = delete;

 private:
  EGLDisplay display_;
};

}  // namespace

glm::vec3 levelColor(int level) {
  assert(level >= 0);
  return kLevelColors[std::min(static_cast<std::size_t>(level), kLevelColors.size() - 1)];
}

// ---------------------------------------------------------------------------------------- context

// The GL objects live as long as the context and die with it. Half floats hold the light without
// visible steps, and go into an EXR as they are.
class OffscreenRenderer::Context {
 public:
  Context() : handles_(openContext()) {
    try {
      const CurrentScope current(handles_);
      createObjects();
    } catch (...) {
      close();
      throw;
    }
  }
  ~Context() { close(); }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  Image render(const RenderMesh& mesh, const RenderOptions& options);

  int greatestSize() const { return greatest_size_; }
  const std::string& deviceName() const { return device_name_; }

 private:
  void close() {
    eglDestroyContext(handles_.display, handles_.context);
    eglDestroySurface(handles_.display, handles_.surface);
  }
  void createObjects();
  void resize(int width, int height);
  void drawBackground(const RenderOptions& options);
  void drawSurface(const RenderMesh& mesh, const RenderOptions& options, const RenderBox& mesh_box,
                   const PlacedCamera& camera);
  void drawFocus(const RenderOptions& options, const PlacedCamera& camera);
  Image readPixels();

  EglHandles handles_;
  std::string device_name_;
  int greatest_size_ = 0;
  int samples_ = 1;
  int width_ = 0;  // of the framebuffers
  int height_ = 0;

  GLuint surface_program_ = 0, background_program_ = 0, line_program_ = 0;
  GLuint surface_array_ = 0, line_array_ = 0, empty_array_ = 0;
  GLuint surface_buffer_ = 0, line_buffer_ = 0;
  GLuint sampled_color_ = 0, sampled_depth_ = 0, resolved_color_ = 0;
  GLuint sampled_frame_ = 0, resolved_frame_ = 0;
};

void OffscreenRenderer::Context::createObjects() {
  device_name_ = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
  GLint renderbuffer_size = 0;
  std::array<GLint, 2> viewport_size{};
  glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &renderbuffer_size);
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport_size.data());
  greatest_size_ = std::min({renderbuffer_size, viewport_size[0], viewport_size[1]});
  GLint most_samples = 1;
  glGetIntegerv(GL_MAX_SAMPLES, &most_samples);
  samples_ = std::min(4, most_samples);

  surface_program_ = linkProgram(kSurfaceVertexShader, kSurfaceFragmentShader);
  background_program_ = linkProgram(kBackgroundVertexShader, kBackgroundFragmentShader);
  line_program_ = linkProgram(kLineVertexShader, kLineFragmentShader);

  glGenVertexArrays(1, &empty_array_);
  glGenVertexArrays(1, &surface_array_);
  glGenBuffers(1, &surface_buffer_);
  glBindVertexArray(surface_array_);
  glBindBuffer(GL_ARRAY_BUFFER, surface_buffer_);
  const auto offset = [](std::size_t bytes) { return reinterpret_cast<const void*>(bytes); };
  glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(SurfaceCorner),
                        offset(offsetof(SurfaceCorner, position_from_eye)));
  glVertexAttribPointer(1, 3, GL_SHORT, GL_TRUE, sizeof(SurfaceCorner),
                        offset(offsetof(SurfaceCorner, normal)));
  glVertexAttribIPointer(2, 1, GL_UNSIGNED_SHORT, sizeof(SurfaceCorner),
                         offset(offsetof(SurfaceCorner, level)));
  for (GLuint attribute = 0; attribute < 3; ++attribute) glEnableVertexAttribArray(attribute);

  glGenVertexArrays(1, &line_array_);
  glGenBuffers(1, &line_buffer_);
  glBindVertexArray(line_array_);
  glBindBuffer(GL_ARRAY_BUFFER, line_buffer_);
  glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(glm::vec3), nullptr);
  glEnableVertexAttribArray(0);

  glGenRenderbuffers(1, &sampled_color_);
  glGenRenderbuffers(1, &sampled_depth_);
  glGenRenderbuffers(1, &resolved_color_);
  glGenFramebuffers(1, &sampled_frame_);
  glGenFramebuffers(1, &resolved_frame_);
}

void OffscreenRenderer::Context::resize(int width, int height) {
  if (width == width_ && height == height_) return;
  width_ = height_ = 0;  // stays so if this fails
  const auto allocate = [&](GLuint buffer, int samples, GLenum format) {
    glBindRenderbuffer(GL_RENDERBUFFER, buffer);
    glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples, format, width, height);
  };
  allocate(sampled_color_, samples_, GL_RGBA16F);
  allocate(sampled_depth_, samples_, GL_DEPTH_COMPONENT32F);
  allocate(resolved_color_, 0, GL_RGBA16F);

  glBindFramebuffer(GL_FRAMEBUFFER, resolved_frame_);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, resolved_color_);
  const bool can_resolve = glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
  glBindFramebuffer(GL_FRAMEBUFFER, sampled_frame_);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, sampled_color_);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, sampled_depth_);
  const bool can_sample = glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
  if (glGetError() != GL_NO_ERROR || !can_resolve || !can_sample) {
    throw Error("cannot render: no memory for a picture of " + std::to_string(width) + " x " +
                std::to_string(height) + " pixels; choose a smaller width or height");
  }
  width_ = width;
  height_ = height;
}

void OffscreenRenderer::Context::drawBackground(const RenderOptions& options) {
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glUseProgram(background_program_);
  setUniform(background_program_, "top", linearColor(options.background_top));
  setUniform(background_program_, "bottom", linearColor(options.background_bottom));
  glBindVertexArray(empty_array_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

void OffscreenRenderer::Context::drawSurface(const RenderMesh& mesh, const RenderOptions& options,
                                             const RenderBox& mesh_box,
                                             const PlacedCamera& camera) {
  const bool with_levels = options.color_by_level && !mesh.triangle_levels.empty();
  std::array<glm::vec3, kLevelColors.size()> colors{};
  std::transform(kLevelColors.begin(), kLevelColors.end(), colors.begin(), linearColor);
  if (!options.color_by_level) colors[0] = linearColor(options.surface_color);

  const glm::dmat3 eye_to_world(camera.right, camera.up, -camera.forward);
  const glm::mat3 world_to_eye(glm::transpose(eye_to_world));
  const DepthRange depth = depthRangeOf(mesh_box, camera);
  const glm::vec4 projection(1.0 / camera.half_width, 1.0 / camera.half_height,
                             -(depth.far + depth.near) / (depth.far - depth.near),
                             -2.0 * depth.far * depth.near / (depth.far - depth.near));

  glEnable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glUseProgram(surface_program_);
  glUniform3fv(glGetUniformLocation(surface_program_, "level_colors"),
               static_cast<GLsizei>(colors.size()), &colors[0][0]);
  setUniform(surface_program_, "back_color", linearColor(options.back_color));
  glUniform1i(glGetUniformLocation(surface_program_, "wireframe"), options.wireframe);
  glUniformMatrix3fv(glGetUniformLocation(surface_program_, "world_to_eye"), 1, GL_FALSE,
                     &world_to_eye[0][0]);
  glUniform4fv(glGetUniformLocation(surface_program_, "projection"), 1, &projection[0]);

  glBindVertexArray(surface_array_);
  glBindBuffer(GL_ARRAY_BUFFER, surface_buffer_);
  const std::size_t triangle_count = mesh.triangles.size() / 3;
  std::vector<SurfaceCorner> corners(3 * std::min(triangle_count, kTrianglesPerPiece));
  for (std::size_t first = 0; first < triangle_count; first += kTrianglesPerPiece) {
    const std::size_t count = std::min(kTrianglesPerPiece, triangle_count - first);
    fillCorners(mesh, first, count, camera.eye, with_levels, corners.data());
    // A new store for each piece: the driver may still be drawing the last one.
    glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(3 * count * sizeof(SurfaceCorner)),
                 corners.data(), GL_STREAM_DRAW);
    glDrawArrays(GL_TRIANGLES, 0, static_cast<GLsizei>(3 * count));
  }
}

void OffscreenRenderer::Context::drawFocus(const RenderOptions& options,
                                           const PlacedCamera& camera) {
  const std::vector<glm::vec3> ribbon =
      outlineRibbon(*options.focus_sphere, camera, options.width, options.height);
  if (ribbon.empty()) return;
  glDisable(GL_DEPTH_TEST);
  glEnable(GL_BLEND);
  glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  glUseProgram(line_program_);
  setUniform(line_program_, "line_color", linearColor(kFocusColor));
  glUniform1f(glGetUniformLocation(line_program_, "half_width"), kFocusLineHalfWidth);
  glBindVertexArray(line_array_);
  glBindBuffer(GL_ARRAY_BUFFER, line_buffer_);
  glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(ribbon.size() * sizeof(glm::vec3)),
               ribbon.data(), GL_STREAM_DRAW);
  glDrawArrays(GL_TRIANGLES, 0, static_cast<GLsizei>(ribbon.size()));
}

Image OffscreenRenderer::Context::readPixels() {
  glBindFramebuffer(GL_READ_FRAMEBUFFER, sampled_frame_);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, resolved_frame_);
  glBlitFramebuffer(0, 0, width_, height_, 0, 0, width_, height_, GL_COLOR_BUFFER_BIT, GL_NEAREST);

  const std::size_t row_floats = 3 * static_cast<std::size_t>(width_);
  Image image{width_, height_, std::vector<float>(row_floats * static_cast<std::size_t>(height_))};
  glBindFramebuffer(GL_READ_FRAMEBUFFER, resolved_frame_);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  // Row by row, because OpenGL counts them from the bottom.
  for (int y = 0; y < height_; ++y) {
    glReadPixels(0, height_ - 1 - y, width_, 1, GL_RGB, GL_FLOAT,
                 image.rgb.data() + static_cast<std::size_t>(y) * row_floats);
  }
  return image;
}

Image OffscreenRenderer::Context::render(const RenderMesh& mesh, const RenderOptions& options) {
  if (options.width < 1 || options.height < 1 || options.width > greatest_size_ ||
      options.height > greatest_size_) {
    throw Error("cannot render a picture of " + std::to_string(options.width) + " x " +
                std::to_string(options.height) + " pixels: width and height are 1 to " +
                std::to_string(greatest_size_));
  }
  if (!(options.vertical_fov >= 1.0 && options.vertical_fov <= 150.0)) {
    throw Error("cannot render with a vertical field of view of " +
                std::to_string(options.vertical_fov) + " degrees: choose 1 to 150");
  }
  const RenderBox mesh_box = boundsOf(mesh.positions);
  const PlacedCamera camera = placeCamera(options, mesh);

  const CurrentScope current(handles_);
  resize(options.width, options.height);
  glBindFramebuffer(GL_FRAMEBUFFER, sampled_frame_);
  glViewport(0, 0, width_, height_);
  glClear(GL_DEPTH_BUFFER_BIT);
  drawBackground(options);
  drawSurface(mesh, options, mesh_box, camera);
  if (options.focus_sphere) drawFocus(options, camera);
  Image image = readPixels();
  if (glGetError() != GL_NO_ERROR) {
    throw Error("cannot render: " + device_name_ +
                " failed, most likely for want of memory; "
                "choose a smaller width or height");
  }
  return image;
}

// --------------------------------------------------------------------------------------- renderer

OffscreenRenderer::OffscreenRenderer() : context_(std::make_unique<Context>()) {}
OffscreenRenderer::~OffscreenRenderer() = default;

Image OffscreenRenderer::render(const RenderMesh& mesh, const RenderOptions& options) {
  assert(mesh.triangles.size() % 3 == 0);
  assert(mesh.normals.empty() || mesh.normals.size() == mesh.positions.size());
  assert(mesh.triangle_levels.empty() || mesh.triangle_levels.size() == mesh.triangles.size() / 3);
  return context_->render(mesh, options);
}

int OffscreenRenderer::greatestSize() const { return context_->greatestSize(); }
const std::string& OffscreenRenderer::deviceName() const { return context_->deviceName(); }

}  // namespace isobrick
