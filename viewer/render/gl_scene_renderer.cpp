#include "isobrick/viewer/render/gl_scene_renderer.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/outline_ribbon.h"
#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {
namespace {

constexpr glm::vec3 kFocusColor{1.0f, 0.93f, 0.62f};
constexpr float kFocusLineHalfWidth = 0.9f;  // pixels
constexpr glm::vec3 kSegmentColor{0.62f, 0.66f, 0.72f};
constexpr float kSegmentHalfWidth = 0.5f;
constexpr GLenum kContextLost = 0x0507;        // GL_CONTEXT_LOST
constexpr GLsizei kIndicesInFlight = 3 << 12;  // drawn and not flushed
constexpr float kOcclusionReach = 1.0f / 16;   // of the picture's height
constexpr double kLeastDistance = 1e-6;        // of segments from the eye, in units of `far`

glm::vec3 linearColor(const glm::vec3& srgb) {
  return {linearFromSrgb(srgb.r), linearFromSrgb(srgb.g), linearFromSrgb(srgb.b)};
}

GlTexture makeTexture(GLenum format, int width, int height) {
  GlTexture texture = GlTexture::make(GLenum{GL_TEXTURE_2D});
  glTextureStorage2D(*texture, 1, format, width, height);
  return texture;
}

// A segment as a ribbon: normalised device coordinates, pixels from its middle, and depth. Empty if
// it is not ahead of the near plane.
void addRibbon(const SceneFrame& frame, const DepthProjection& depth, const DepthRange& range,
               const SceneSegment& segment, std::vector<glm::vec4>& ribbon) {
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
    const glm::dvec2 place = (pixel + side * across) / half_size;
    return glm::vec4(glm::dvec4(place, side * reach, depth.depthAt(end.distance)));
  };
  for (const glm::vec4& place : {corner(p, a, -1), corner(q, b, -1), corner(q, b, 1),
                                 corner(p, a, -1), corner(q, b, 1), corner(p, a, 1)})
    ribbon.push_back(place);
}

}  // namespace

struct GlSceneRenderer::View {
  explicit View(const SceneFrame& f)
      : frame(f),
        range(depthRangeOf(f.bounds, f.camera)),
        depth(reversedDepth(range, f.camera.orthographic)),
        to_eye(glm::transpose(glm::dmat3(f.camera.right, f.camera.up, -f.camera.forward))),
        projection(1.0 / f.camera.half_width, 1.0 / f.camera.half_height, depth.scale,
                   depth.offset) {
    const glm::dvec3 eye = f.lattice.toLattice(f.camera.eye);
    double reach = 1.0;
    if (!f.bounds.empty())
      for (const glm::dvec3& corner : cornersOf(f.bounds))
        reach = std::max(reach, glm::distance(f.lattice.toLattice(corner), eye));
    snapped = snapEye(eye, reach);
    for (const SceneClipPlane& plane : f.clip_planes) clip_planes.push_back(planeSeen(plane));
  }
  // In eye coordinates.
  glm::vec4 planeSeen(const SceneClipPlane& plane) const {
    return glm::vec4(
        glm::dvec4(to_eye * plane.normal, glm::dot(plane.normal, frame.camera.eye) - plane.offset));
  }
  glm::vec3 eyePosition(const glm::dvec3& world) const {
    return glm::vec3(to_eye * (world - frame.camera.eye));
  }

  const SceneFrame& frame;
  DepthRange range;
  DepthProjection depth;
  glm::dmat3 to_eye;  // world axes to eye axes
  glm::vec4 projection;
  SnappedEye snapped;
  std::vector<glm::vec4> clip_planes;  // eye coordinates
};

GlSceneRenderer::GlSceneRenderer(Uploads uploads) {
  device_name_ = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
  for (const char* rasteriser : {"llvmpipe", "softpipe"})  // also below Vulkan
    is_software_ = is_software_ || device_name_.find(rasteriser) != std::string::npos;
  GLint renderbuffer_size = 0;
  std::array<GLint, 2> viewport_size{};
  glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &renderbuffer_size);
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport_size.data());
  greatest_size_ = std::min({renderbuffer_size, viewport_size[0], viewport_size[1]});
  GLint most_samples = 1;
  glGetIntegerv(GL_MAX_SAMPLES, &most_samples);
  samples_ = std::min(4, most_samples);
  if (uploads == Uploads::kStaged || !is_software_) staging_.emplace();
  if (staging_ && !staging_->isThere()) staging_.reset();

  surface_program_ = makeSurfaceProgram(false);
  wire_program_ = makeSurfaceProgram(true);
  background_program_ = makeBackgroundProgram();
  line_program_ = makeLineProgram();
  slice_program_ = makeSliceProgram();
  sphere_program_ = makeSphereProgram();
  screen_program_ = makeScreenProgram();
  occlusion_program_ = makeOcclusionProgram();
  shade_program_ = makeShadeProgram();

  empty_array_ = GlVertexArray::make();
  surface_array_ = GlVertexArray::make();
  glVertexArrayAttribFormat(*surface_array_, 0, 3, GL_FLOAT, GL_FALSE,
                            offsetof(SurfaceVertex, position));
  static_assert(offsetof(SurfaceVertex, value) == offsetof(SurfaceVertex, normal) + 6);
  glVertexArrayAttribFormat(*surface_array_, 1, 4, GL_SHORT, GL_TRUE,
                            offsetof(SurfaceVertex, normal));
  for (const GLuint attribute : {0u, 1u}) {
    glVertexArrayAttribBinding(*surface_array_, attribute, 0);
    glEnableVertexArrayAttrib(*surface_array_, attribute);
  }
  line_array_ = GlVertexArray::make();
  line_buffer_ = GlBuffer::make();
  glVertexArrayAttribFormat(*line_array_, 0, 4, GL_FLOAT, GL_FALSE, 0);
  glVertexArrayAttribBinding(*line_array_, 0, 0);
  glEnableVertexArrayAttrib(*line_array_, 0);
  glVertexArrayVertexBuffer(*line_array_, 0, *line_buffer_, 0, sizeof(glm::vec4));
}

// Errors of earlier calls, those of a panel among them, are none of the next ones, but for a loss,
// which a driver may report once, or for ever.
void GlSceneRenderer::forgetErrors() {
  constexpr int kMostKinds = 16;
  GLenum error = GL_NO_ERROR;
  for (int i = 0; i < kMostKinds && (error = glGetError()) != GL_NO_ERROR; ++i)
    is_lost_ = is_lost_ || error == kContextLost;
  if (is_lost_) throw RendererLost();
}

// For the calls since forgetErrors().
void GlSceneRenderer::checkErrors(const std::string& if_no_memory) {
  const GLenum error = glGetError();
  if (error == GL_NO_ERROR) return;
  is_lost_ = is_lost_ || error == kContextLost;
  forgetErrors();
  if (isLost()) throw RendererLost();
  if (error == GL_OUT_OF_MEMORY) throw NoGraphicsMemory(if_no_memory);
  throw Error("cannot draw: " + device_name_ + " reports the OpenGL error " +
              std::to_string(error) + "; please report it, with the version of the driver");
}

// ----------------------------------------------------------------------------------- kept objects

ChunkId GlSceneRenderer::reserve(const SurfaceChunk& chunk) {
  Chunk kept;
  kept.buffer = GlBuffer::make();
  kept.bytes = chunk.bytes();
  kept.indices = static_cast<GLsizei>(chunk.triangles.size());
  kept.transition_indices = static_cast<GLsizei>(chunk.transition_indices);
  const std::size_t vertex_bytes = chunk.vertices.size() * sizeof(SurfaceVertex);
  kept.index_offset = static_cast<std::uint32_t>(vertex_bytes);
  kept.origin = chunk.origin;
  kept.level = chunk.level;
  kept.surface = chunk.surface;
  if (kept.bytes > 0) {
    forgetErrors();
    glNamedBufferStorage(*kept.buffer, static_cast<GLsizeiptr>(kept.bytes), nullptr,
                         GL_DYNAMIC_STORAGE_BIT);
    checkErrors("cannot keep " + std::to_string(kept.bytes) + " bytes of a surface: " +
                device_name_ + " has no memory left; ask for a smaller radius");
  }
  bytes_kept_ += kept.bytes;
  chunks_.emplace(++last_chunk_, std::move(kept));
  return last_chunk_;
}

// Bytes of a chunk as runs in memory: f(first byte, offset in the buffer, count), until it is
// false.
template <typename F>
bool GlSceneRenderer::forParts(const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes,
                               F&& f) {
  const std::size_t vertex_bytes = chunk.vertices.size() * sizeof(SurfaceVertex);
  const std::size_t end = begin + bytes;
  const auto* const vertices = reinterpret_cast<const std::byte*>(chunk.vertices.data());
  const auto* const triangles = reinterpret_cast<const std::byte*>(chunk.triangles.data());
  if (begin < vertex_bytes && !f(vertices + begin, begin, std::min(end, vertex_bytes) - begin))
    return false;
  const std::size_t rest = std::max(begin, vertex_bytes);
  return rest >= end || f(triangles + (rest - vertex_bytes), rest, end - rest);
}

void GlSceneRenderer::fill(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                           std::size_t bytes) {
  const GLuint buffer = *chunks_.at(id).buffer;
  forParts(chunk, begin, bytes, [&](const std::byte* data, std::size_t offset, std::size_t count) {
    glNamedBufferSubData(buffer, static_cast<GLintptr>(offset), static_cast<GLsizeiptr>(count),
                         data);
    return true;
  });
}

bool GlSceneRenderer::uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                                  std::size_t bytes) {
  if (!staging_) {
    fill(id, chunk, begin, bytes);
    return true;
  }
  // If the second of two parts finds no room, the first comes again.
  const GLuint buffer = *chunks_.at(id).buffer;
  return forParts(chunk, begin, bytes,
                  [&](const std::byte* data, std::size_t offset, std::size_t count) {
                    return staging_->copy(data, count, buffer, offset);
                  });
}

void GlSceneRenderer::endUploads() {
  if (staging_) staging_->endFrame();
}

ChunkId GlSceneRenderer::upload(const SurfaceChunk& chunk) {
  const ChunkId id = reserve(chunk);
  fill(id, chunk, 0, static_cast<std::size_t>(chunk.bytes()));
  return id;
}

void GlSceneRenderer::release(ChunkId chunk) {
  const auto found = chunks_.find(chunk);
  assert(found != chunks_.end());
  bytes_kept_ -= found->second.bytes;
  chunks_.erase(found);
}

SurfaceChunk GlSceneRenderer::download(ChunkId id) const {
  const Chunk& kept = chunks_.at(id);
  SurfaceChunk chunk;
  chunk.origin = kept.origin;
  chunk.level = kept.level;
  chunk.surface = kept.surface;
  chunk.transition_indices = static_cast<std::size_t>(kept.transition_indices);
  chunk.vertices.resize(kept.index_offset / sizeof(SurfaceVertex));
  chunk.triangles.resize(static_cast<std::size_t>(kept.indices));
  if (kept.bytes == 0) return chunk;
  glGetNamedBufferSubData(*kept.buffer, 0, static_cast<GLsizeiptr>(kept.index_offset),
                          chunk.vertices.data());
  glGetNamedBufferSubData(*kept.buffer, static_cast<GLintptr>(kept.index_offset),
                          static_cast<GLsizeiptr>(kept.bytes - kept.index_offset),
                          chunk.triangles.data());
  return chunk;
}

SliceId GlSceneRenderer::reserveSlice(int width, int height) {
  Slice kept;
  forgetErrors();
  kept.texture = GlTexture::make(GLenum{GL_TEXTURE_2D});
  kept.bytes =
      sizeof(float) * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  glTextureStorage2D(*kept.texture, 1, GL_R32F, width, height);
  glTextureParameteri(*kept.texture, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
  glTextureParameteri(*kept.texture, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  glTextureParameteri(*kept.texture, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTextureParameteri(*kept.texture, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
  checkErrors("cannot keep a slice of " + std::to_string(width) + " x " + std::to_string(height) +
              " values: " + device_name_ + " has no memory left; show fewer slices");
  bytes_kept_ += kept.bytes;
  slices_.emplace(++last_slice_, std::move(kept));
  return last_slice_;
}

void GlSceneRenderer::uploadRows(SliceId slice, const SliceImage& image, int first, int count) {
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glTextureSubImage2D(*slices_.at(slice).texture, 0, 0, first, image.width, count, GL_RED, GL_FLOAT,
                      image.values.data() +
                          static_cast<std::size_t>(first) * static_cast<std::size_t>(image.width));
}

void GlSceneRenderer::releaseSlice(SliceId slice) {
  const auto found = slices_.find(slice);
  assert(found != slices_.end());
  bytes_kept_ -= found->second.bytes;
  slices_.erase(found);
}

// ----------------------------------------------------------------------------------------- drawing

void GlSceneRenderer::resize(int width, int height) {
  if (width == width_ && height == height_) return;
  width_ = height_ = 0;  // stays so if this fails
  forgetErrors();
  const auto allocate = [&](GlRenderbuffer& buffer, int samples, GLenum format) {
    buffer = GlRenderbuffer::make();
    glNamedRenderbufferStorageMultisample(*buffer, samples, format, width, height);
  };
  allocate(sampled_color_, samples_, GL_RGBA16F);
  allocate(sampled_depth_, samples_, GL_DEPTH_COMPONENT32F);
  resolved_color_ = makeTexture(GL_RGBA16F, width, height);
  resolved_depth_ = makeTexture(GL_DEPTH_COMPONENT32F, width, height);
  openness_ = {};

  sampled_frame_ = GlFramebuffer::make();
  glNamedFramebufferRenderbuffer(*sampled_frame_, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER,
                                 *sampled_color_);
  glNamedFramebufferRenderbuffer(*sampled_frame_, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER,
                                 *sampled_depth_);
  resolved_frame_ = GlFramebuffer::make();
  glNamedFramebufferTexture(*resolved_frame_, GL_COLOR_ATTACHMENT0, *resolved_color_, 0);
  glNamedFramebufferTexture(*resolved_frame_, GL_DEPTH_ATTACHMENT, *resolved_depth_, 0);
  const auto complete = [](const GlFramebuffer& frame) {
    return glCheckNamedFramebufferStatus(*frame, GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
  };
  const std::string no_memory = "cannot render: no memory for a picture of " +
                                std::to_string(width) + " x " + std::to_string(height) +
                                " pixels; choose a smaller width or height";
  checkErrors(no_memory);
  if (complete(sampled_frame_) && complete(resolved_frame_)) {
    width_ = width;
    height_ = height;
    return;
  }
  if (isLost()) throw RendererLost();
  throw NoGraphicsMemory(no_memory);
}

void GlSceneRenderer::draw(const SceneFrame& frame) {
  assert(frame.width > 0 && frame.height > 0 && frame.clip_planes.size() <= 6);
  resize(frame.width, frame.height);
  forgetErrors();
  const View view(frame);
  depth_ = view.depth;
  transparent_ = frame.transparent;
  glBindFramebuffer(GL_FRAMEBUFFER, *sampled_frame_);
  glViewport(0, 0, width_, height_);
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_CULL_FACE);
  glDisable(GL_FRAMEBUFFER_SRGB);
  glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
  glDepthMask(GL_TRUE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glClearDepth(0.0);
  glClear(GL_DEPTH_BUFFER_BIT);
  glDepthFunc(GL_GREATER);
  drawBackground(frame);
  const auto cut = [&](std::size_t planes) {
    for (GLenum i = 0; i < 6; ++i) (i < planes ? glEnable : glDisable)(GL_CLIP_DISTANCE0 + i);
  };
  cut(frame.clip_planes.size());
  drawOpaqueSurfaces(view);
  if (frame.ambient_occlusion && !frame.normals) {
    cut(0);
    drawOcclusion(view);
    cut(frame.clip_planes.size());
  }
  // Translucent surfaces write depth, so opaque slices behind them come first.
  drawSlices(view, false);
  drawTranslucentSurfaces(view);
  if (!frame.normals) drawSlices(view, true);
  cut(0);
  if (!frame.normals) {
    drawSegments(view);
    drawSphere(view);
  }

  glBlitNamedFramebuffer(*sampled_frame_, *resolved_frame_, 0, 0, width_, height_, 0, 0, width_,
                         height_, GL_COLOR_BUFFER_BIT, GL_NEAREST);
  // Code that draws next to it (a panel) does not expect these.
  glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
  glDisable(GL_DEPTH_TEST);
  glBindVertexArray(0);
  checkErrors("cannot render: " + device_name_ +
              " has no memory left; choose a smaller width or height");
}

void GlSceneRenderer::drawBackground(const SceneFrame& frame) {
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  if (frame.transparent || frame.normals) {
    glClearColor(0.0f, 0.0f, 0.0f, 0.0f);
    return glClear(GL_COLOR_BUFFER_BIT);
  }
  glUseProgram(*background_program_);
  setUniform(background_program_, "top", linearColor(frame.background_top));
  setUniform(background_program_, "bottom", linearColor(frame.background_bottom));
  glBindVertexArray(*empty_array_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

// `uncut_plane`: the plane that does not cut.
void GlSceneRenderer::setView(const GlProgram& program, const View& view, int uncut_plane) const {
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

const GlProgram& GlSceneRenderer::useSurfaceProgram(const View& view) const {
  const SceneFrame& frame = view.frame;
  const GlProgram& program = frame.wireframe ? wire_program_ : surface_program_;
  setView(program, view);
  setUniform(program, "lattice_to_eye", glm::mat3(view.to_eye * frame.lattice.matrix));
  setUniform(program, "world_to_eye", glm::mat3(view.to_eye));
  setUniform(program, "eye_rest", glm::vec3(view.snapped.rest));
  setUniform(program, "as_normals", static_cast<int>(frame.normals));
  setUniform(program, "by_value", static_cast<int>(frame.value_window.has_value()));
  if (frame.value_window) {
    const auto [low, high] = *frame.value_window;
    setUniform(program, "value_window", glm::vec2(glm::dvec2(low, high)));
    setUniform(program, "value_colors", colorsOf(frame.color_map));
  }
  setUniform(program, "by_plane", static_cast<int>(frame.value_plane.has_value()));
  if (frame.value_plane) setUniform(program, "value_plane", view.planeSeen(*frame.value_plane));
  setUniform(program, "headlight", static_cast<int>(frame.headlight));
  setUniform(program, "back_color", linearColor(frame.back_color));
  glBindVertexArray(frame.wireframe ? *empty_array_ : *surface_array_);
  glEnable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  return program;
}

void GlSceneRenderer::drawOpaqueSurfaces(const View& view) {
  const SceneFrame& frame = view.frame;
  if (frame.chunks.empty()) return;
  const GlProgram& program = useSurfaceProgram(view);
  for (std::size_t s = 0; s < frame.surfaces.size(); ++s)
    if (frame.surfaces[s].opacity >= 1.0) drawChunks(view, program, static_cast<int>(s), true);
}

// Only the nearest part of one is seen, so its depth goes first.
void GlSceneRenderer::drawTranslucentSurfaces(const View& view) {
  const SceneFrame& frame = view.frame;
  std::vector<int> translucent;
  for (std::size_t s = 0; s < frame.surfaces.size(); ++s)
    if (frame.surfaces[s].opacity > 0.0 && frame.surfaces[s].opacity < 1.0)
      translucent.push_back(static_cast<int>(s));
  if (translucent.empty() || frame.chunks.empty()) return;
  const GlProgram& program = useSurfaceProgram(view);
  std::stable_sort(translucent.begin(), translucent.end(), [&](int a, int b) {
    return frame.surfaces[static_cast<std::size_t>(a)].order <
           frame.surfaces[static_cast<std::size_t>(b)].order;
  });
  for (const int surface : translucent) {
    glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
    drawChunks(view, program, surface, true);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    glDepthFunc(GL_EQUAL);
    if (!frame.normals) glEnable(GL_BLEND);
    glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    drawChunks(view, program, surface, false);
    glDisable(GL_BLEND);
    glDepthFunc(GL_GREATER);
  }
}

void GlSceneRenderer::drawChunks(const View& view, const GlProgram& program, int surface,
                                 bool opaque) {
  const SceneFrame& frame = view.frame;
  const SurfaceLook& look = frame.surfaces[static_cast<std::size_t>(surface)];
  const GLint offset_place = glGetUniformLocation(*program, "chunk_offset");
  const GLint color_place = glGetUniformLocation(*program, "surface_color");
  const GLint by_value_place = glGetUniformLocation(*program, "by_value");
  const GLint first_place = glGetUniformLocation(*program, "first_index");
  const float opacity = opaque ? 1.0f : static_cast<float>(look.opacity);
  const auto setColor = [&](const glm::vec3& srgb) {
    const glm::vec3 color = linearColor(srgb);
    glUniform4f(color_place, color.r, color.g, color.b, opacity);
  };
  for (const ChunkId id : frame.chunks) {
    const Chunk& chunk = chunks_.at(id);
    if (chunk.surface != surface || chunk.indices == 0) continue;
    const glm::vec3 offset = view.snapped.offsetOf(chunk.origin);
    glUniform3fv(offset_place, 1, &offset[0]);
    setColor(frame.color_by_level ? levelColor(frame.first_level + chunk.level) : look.color);
    if (frame.wireframe) {
      glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, *chunk.buffer);
    } else {
      glVertexArrayVertexBuffer(*surface_array_, 0, *chunk.buffer, 0, sizeof(SurfaceVertex));
      glVertexArrayElementBuffer(*surface_array_, *chunk.buffer);
    }
    const GLsizei highlighted = frame.transition_color ? chunk.transition_indices : 0;
    drawIndices(chunk, 0, chunk.indices - highlighted, frame.wireframe, first_place);
    if (highlighted == 0) continue;
    setColor(*frame.transition_color);
    glUniform1i(by_value_place, 0);
    drawIndices(chunk, chunk.indices - highlighted, chunk.indices, frame.wireframe, first_place);
    glUniform1i(by_value_place, frame.value_window.has_value());
  }
}

void GlSceneRenderer::drawIndices(const Chunk& chunk, GLsizei begin, GLsizei end, bool wireframe,
                                  GLint first_place) {
  for (GLsizei first = begin; first < end; first += kIndicesInFlight) {
    const GLsizei count = std::min(end - first, kIndicesInFlight);
    const std::size_t place =
        chunk.index_offset + sizeof(std::uint32_t) * static_cast<std::size_t>(first);
    if (wireframe) {
      glUniform1ui(first_place, static_cast<GLuint>(place / sizeof(std::uint32_t)));
      glDrawArrays(GL_TRIANGLES, 0, count);
    } else {
      glDrawElements(GL_TRIANGLES, count, GL_UNSIGNED_INT, reinterpret_cast<const void*>(place));
    }
    boundFlight(count);
  }
}

// Mesa's rasteriser in software sets all triangles up before it draws them, half a kilobyte each,
// in scenes of 36 MiB of which it keeps two and more: several times the memory of the chunks. An
// early flush needs less of it, and its triangles are drawn while the next ones are set up.
void GlSceneRenderer::boundFlight(GLsizei indices) {
  indices_in_flight_ += indices;
  if (!is_software_ || indices_in_flight_ < kIndicesInFlight) return;
  indices_in_flight_ = 0;
  const GlFence before = std::exchange(last_flight_, GlFence::make());
  glFlush();
  before.wait();
}

// Comes before slices and caps, whose colours stand for values. Depth is that of one sample of a
// pixel; samples of the background stay as they are.
void GlSceneRenderer::drawOcclusion(const View& view) {
  if (*openness_ == 0) {
    openness_ = makeTexture(GL_R8, width_, height_);
    openness_frame_ = GlFramebuffer::make();
    glNamedFramebufferTexture(*openness_frame_, GL_COLOR_ATTACHMENT0, *openness_, 0);
  }
  glBlitNamedFramebuffer(*sampled_frame_, *resolved_frame_, 0, 0, width_, height_, 0, 0, width_,
                         height_, GL_DEPTH_BUFFER_BIT, GL_NEAREST);
  glBindTextureUnit(0, *resolved_depth_);
  glBindTextureUnit(1, *openness_);
  glBindVertexArray(*empty_array_);
  const auto cover = [&](const GlProgram& program) {
    glUseProgram(*program);
    setUniform(program, "projection", view.projection);
    setUniform(program, "orthographic", static_cast<int>(view.frame.camera.orthographic));
    setUniform(program, "reach", kOcclusionReach * static_cast<float>(height_));
    glDrawArrays(GL_TRIANGLES, 0, 3);
  };
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glBindFramebuffer(GL_FRAMEBUFFER, *openness_frame_);
  cover(occlusion_program_);
  glBindFramebuffer(GL_FRAMEBUFFER, *sampled_frame_);
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_FALSE);
  glDepthFunc(GL_LESS);  // passes everything that is not background
  glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_ZERO, GL_SRC_COLOR, GL_ZERO, GL_ONE);
  cover(shade_program_);
  glDisable(GL_BLEND);
  glDepthFunc(GL_GREATER);
  glDepthMask(GL_TRUE);
}

// The farthest first. Opaque ones only hide the normals of surfaces.
void GlSceneRenderer::drawSlices(const View& view, bool blends) {
  std::vector<SceneSlice> slices;
  for (const SceneSlice& slice : view.frame.slices)
    if ((slice.opacity < 1.0) == blends) slices.push_back(slice);
  const auto away = [&](const SceneSlice& slice) {
    const glm::dvec3 middle = slice.corner + 0.5 * (slice.across + slice.along);
    return glm::dot(middle - view.frame.camera.eye, view.frame.camera.forward);
  };
  std::stable_sort(slices.begin(), slices.end(),
                   [&](const SceneSlice& a, const SceneSlice& b) { return away(a) > away(b); });
  glEnable(GL_DEPTH_TEST);
  if (view.frame.normals) glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  glBindVertexArray(*empty_array_);
  (blends ? glEnable : glDisable)(GL_BLEND);
  glDepthMask(blends ? GL_FALSE : GL_TRUE);
  for (const SceneSlice& slice : slices) {
    setView(slice_program_, view, slice.cap_of);
    setUniform(slice_program_, "corner", view.eyePosition(slice.corner));
    setUniform(slice_program_, "across", glm::vec3(view.to_eye * slice.across));
    setUniform(slice_program_, "along", glm::vec3(view.to_eye * slice.along));
    setUniform(slice_program_, "window", glm::vec2(glm::dvec2(slice.black, slice.white)));
    setUniform(slice_program_, "least_value",
               slice.least_value ? static_cast<float>(*slice.least_value)
                                 : std::numeric_limits<float>::lowest());
    setUniform(slice_program_, "opacity", static_cast<float>(blends ? slice.opacity : 1.0));
    glBindTextureUnit(0, *slices_.at(slice.image).texture);
    glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
  }
  glDisable(GL_BLEND);
  glDepthMask(GL_TRUE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

void GlSceneRenderer::drawSegments(const View& view) {
  std::vector<glm::vec4> ribbon;
  for (const SceneSegment& segment : view.frame.segments)
    addRibbon(view.frame, view.depth, view.range, segment, ribbon);
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_FALSE);
  drawRibbon(ribbon, kSegmentColor, kSegmentHalfWidth * static_cast<float>(view.frame.pixel_scale),
             0.15f);
  glDepthMask(GL_TRUE);
}

void GlSceneRenderer::drawSphere(const View& view) {
  const SceneFrame& frame = view.frame;
  if (!frame.sphere || !(frame.sphere->radius > 0.0)) return;
  if (frame.fill_sphere) {
    setView(sphere_program_, view);
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
  for (const glm::vec3& place : outlineRibbon(*frame.sphere, frame.camera, frame.width,
                                              frame.height, half_width + kLineReach))
    ribbon.emplace_back(place, 0.0f);
  glDisable(GL_DEPTH_TEST);
  drawRibbon(ribbon, kFocusColor, half_width, 0.5f);
}

void GlSceneRenderer::drawRibbon(const std::vector<glm::vec4>& ribbon, const glm::vec3& color,
                                 float half_width, float casing) {
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

// ----------------------------------------------------------------------------------------- results

std::optional<double> GlSceneRenderer::distanceAt(const glm::dvec2& pixel) {
  const int x = static_cast<int>(pixel.x), y = height_ - 1 - static_cast<int>(pixel.y);
  if (pixel.x < 0.0 || pixel.y < 0.0 || x >= width_ || y < 0) return std::nullopt;
  // Samples may be resolved only if both rectangles are the same.
  glBlitNamedFramebuffer(*sampled_frame_, *resolved_frame_, x, y, x + 1, y + 1, x, y, x + 1, y + 1,
                         GL_DEPTH_BUFFER_BIT, GL_NEAREST);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, *resolved_frame_);
  float depth = 0.0f;
  glReadPixels(x, y, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, &depth);
  if (!(depth > 0.0f)) return std::nullopt;
  return depth_.distanceAt(depth);
}

Image GlSceneRenderer::picture() {
  const std::size_t row_floats = 3 * static_cast<std::size_t>(width_);
  const std::size_t pixels = static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  Image image{width_, height_, std::vector<float>(3 * pixels)};
  if (transparent_) image.alpha.resize(pixels);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, *resolved_frame_);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  // Row by row, because OpenGL counts them from the bottom.
  for (int y = 0; y < height_; ++y) {
    glReadPixels(0, height_ - 1 - y, width_, 1, GL_RGB, GL_FLOAT,
                 image.rgb.data() + static_cast<std::size_t>(y) * row_floats);
    if (transparent_)
      glReadPixels(0, height_ - 1 - y, width_, 1, GL_ALPHA, GL_FLOAT,
                   image.alpha.data() + static_cast<std::size_t>(y) * row_floats / 3);
  }
  if (isLost()) throw RendererLost();  // nothing was read
  return image;
}

std::vector<float> GlSceneRenderer::distances() {
  glBlitNamedFramebuffer(*sampled_frame_, *resolved_frame_, 0, 0, width_, height_, 0, 0, width_,
                         height_, GL_DEPTH_BUFFER_BIT, GL_NEAREST);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, *resolved_frame_);
  const auto row = static_cast<std::size_t>(width_);
  std::vector<float> distances(row * static_cast<std::size_t>(height_));
  for (int y = 0; y < height_; ++y)
    glReadPixels(0, height_ - 1 - y, width_, 1, GL_DEPTH_COMPONENT, GL_FLOAT,
                 distances.data() + static_cast<std::size_t>(y) * row);
  if (isLost()) throw RendererLost();
  for (float& value : distances)
    value = value > 0.0f ? static_cast<float>(depth_.distanceAt(value))
                         : std::numeric_limits<float>::infinity();
  return distances;
}

// The driver reports a reset until it is over, so the first report counts.
bool GlSceneRenderer::isLost() {
  is_lost_ = is_lost_ || glGetGraphicsResetStatus() != GL_NO_ERROR;
  return is_lost_;
}

void GlSceneRenderer::presentNothing(GLuint framebuffer, int width, int height) {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glViewport(0, 0, width, height);
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glClearColor(0.16f, 0.17f, 0.19f, 1.0f);
  glClear(GL_COLOR_BUFFER_BIT);
}

void GlSceneRenderer::present(GLuint framebuffer, int left, int bottom) {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glViewport(left, bottom, width_, height_);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glDisable(GL_SCISSOR_TEST);
  glUseProgram(*screen_program_);
  setUniform(screen_program_, "corner", glm::vec2(left, bottom));
  glBindTextureUnit(0, *resolved_color_);
  glBindVertexArray(*empty_array_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glBindVertexArray(0);
}

}  // namespace isobrick
