#include "isobrick/viewer/offscreen_renderer.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <glm/vec4.hpp>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/render_camera.h"
#include "isobrick/viewer/render_shaders.h"
#include "isobrick/viewer/sphere_outline.h"
#include "isobrick/viewer/surface_corners.h"

namespace isobrick {
namespace {

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
static_assert(kLevelColors.size() == kShadedLevels);

glm::vec3 linearColor(const glm::vec3& srgb) {
  return {linearFromSrgb(srgb.r), linearFromSrgb(srgb.g), linearFromSrgb(srgb.b)};
}

constexpr glm::vec3 kFocusColor{1.0f, 0.93f, 0.62f};
constexpr float kFocusLineHalfWidth = 0.9f;  // pixels

constexpr std::size_t kTrianglesPerPiece = std::size_t{1} << 18;  // 15 MiB of corners

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
  Context() {
    const EglContext::CurrentScope current(egl_);
    createObjects();
  }

  Image render(const RenderMesh& mesh, const RenderOptions& options);

  int greatestSize() const { return greatest_size_; }
  const std::string& deviceName() const { return device_name_; }

 private:
  void createObjects();
  void resize(int width, int height);
  void drawBackground(const RenderOptions& options);
  void drawSurface(const RenderMesh& mesh, const RenderOptions& options, const RenderBox& mesh_box,
                   const PlacedCamera& camera);
  void drawFocus(const RenderOptions& options, const PlacedCamera& camera);
  Image readPixels();

  EglContext egl_;
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

  surface_program_ = makeSurfaceProgram();
  background_program_ = makeBackgroundProgram();
  line_program_ = makeLineProgram();

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
  const DepthRange depth =
      depthRangeOf(WorldBox{glm::dvec3(mesh_box.lower), glm::dvec3(mesh_box.upper)}, camera);
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
      outlineRibbon(*options.focus_sphere, camera, options.width, options.height,
                    kFocusLineHalfWidth + kLineReach);
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

  const EglContext::CurrentScope current(egl_);
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
