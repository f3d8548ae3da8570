#include "isobrick/viewer/offscreen_renderer.h"

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <glm/geometric.hpp>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "isobrick/viewer/render_mesh.h"
#include "isobrick/viewer/view_picture.h"

namespace isobrick {
namespace {

// For meshes too: the frame includes unused positions, and chunks hold only used ones.
template <typename ForEachPoint>
SceneFrame frameOf(const RenderOptions& options, const SceneLattice& lattice,
                   const WorldBox& bounds, ForEachPoint&& forEachPoint) {
  SceneFrame frame;
  frame.width = options.width;
  frame.height = options.height;
  frame.camera = placeCamera(options, forEachPoint);
  frame.bounds = bounds;
  frame.lattice = lattice;
  frame.surfaces[0].color = options.surface_color;
  frame.color_by_level = options.color_by_level;
  frame.color_by_component = options.color_by_component;
  frame.wireframe = options.wireframe;
  frame.ambient_occlusion = options.ambient_occlusion;
  frame.shadow = options.shadow;
  frame.sphere = options.focus_sphere;
  frame.back_color = options.back_color;
  frame.background_top = options.background_top;
  frame.background_bottom = options.background_bottom;
  frame.pixel_scale = lineScaleOf(frame.width, frame.height);
  return frame;
}

// From the eye to the target, or to the middle of what is framed.
double targetDistance(const RenderOptions& options, const SceneFrame& frame) {
  if (options.look_at) return glm::distance(options.look_at->eye, options.look_at->target);
  const std::optional<RenderBox>& box = options.orbit.box;
  const glm::dvec3 middle =
      box ? 0.5 * (glm::dvec3(box->lower) + glm::dvec3(box->upper)) : frame.bounds.center();
  return glm::dot(middle - frame.camera.eye, frame.camera.forward);
}

void checkOptions(const RenderOptions& options) {
  checkPictureSize(options.width, options.height);
  if (!(options.vertical_fov >= 1.0 && options.vertical_fov <= 150.0)) {
    throw Error("cannot render with a vertical field of view of " +
                std::to_string(options.vertical_fov) + " degrees: choose 1 to 150");
  }
}

template <typename ForEachPoint>
std::vector<SceneWithNotes> scenesOf(std::span<const RenderOptions> options,
                                     const SceneLattice& lattice, ForEachPoint&& forEachPoint) {
  WorldBox bounds = emptyWorldBox();
  forEachPoint([&](const glm::dvec3& point) { bounds.include(point); });
  std::vector<SceneWithNotes> scenes;
  for (const RenderOptions& each : options) {
    checkOptions(each);
    const SceneFrame frame = frameOf(each, lattice, bounds, forEachPoint);
    scenes.push_back({frame, false, each.notes, targetDistance(each, frame)});
  }
  return scenes;
}

}  // namespace

// ---------------------------------------------------------------------------------------- context

class OffscreenRenderer::Context {
 public:
  Context() {
    const EglContext::CurrentScope current(egl_);
    scene_ = std::make_unique<GlSceneRenderer>();
  }
  ~Context() {
    const EglContext::CurrentScope current(egl_);
    scene_.reset();
  }

  using TakeRows = std::function<void(std::size_t picture, Image rows, double share)>;
  void renderEach(std::vector<SurfaceChunk> chunks, std::vector<SceneWithNotes> scenes,
                  const TakeRows& take);

  const std::string& deviceName() const { return scene_->deviceName(); }

 private:
  EglContext egl_;
  std::unique_ptr<GlSceneRenderer> scene_;
};

void OffscreenRenderer::Context::renderEach(std::vector<SurfaceChunk> chunks,
                                            std::vector<SceneWithNotes> scenes,
                                            const TakeRows& take) {
  const EglContext::CurrentScope current(egl_);
  std::vector<ChunkId> kept;
  kept.reserve(chunks.size());
  const auto forget = [&] {
    for (const ChunkId chunk : kept) scene_->release(chunk);
  };
  try {
    for (SurfaceChunk& chunk : chunks) kept.push_back(scene_->upload(std::exchange(chunk, {})));
    for (std::size_t i = 0; i < scenes.size(); ++i) {
      scenes[i].frame.chunks = kept;
      PictureTiles tiles(*scene_, std::move(scenes[i]));
      while (!tiles.done())
        if (std::optional<Image> rows = tiles.drawNext()) take(i, std::move(*rows), tiles.share());
    }
  } catch (...) {
    forget();
    throw;
  }
  forget();
}

// --------------------------------------------------------------------------------------- renderer

OffscreenRenderer::OffscreenRenderer() : context_(std::make_unique<Context>()) {}
OffscreenRenderer::~OffscreenRenderer() = default;

Image OffscreenRenderer::render(const RenderMesh& mesh, const RenderOptions& options) {
  assert(mesh.triangles.size() % 3 == 0);
  assert(mesh.normals.empty() || mesh.normals.size() == mesh.positions.size());
  assert(mesh.triangle_levels.empty() || mesh.triangle_levels.size() == mesh.triangles.size() / 3);
  const auto forEachPoint = [&](auto&& f) {
    for (const glm::vec3& position : mesh.positions) f(glm::dvec3(position));
  };
  std::vector<SceneWithNotes> scenes = scenesOf({&options, 1}, SceneLattice{}, forEachPoint);
  Image picture;
  context_->renderEach(chunksOf(mesh, options.color_by_level), std::move(scenes),
                       [&](std::size_t, Image rows, double) { appendRows(rows, picture); });
  return picture;
}

Image OffscreenRenderer::render(std::vector<SurfaceChunk> chunks, const SceneLattice& lattice,
                                const RenderOptions& options) {
  Image picture;
  renderRows(std::move(chunks), lattice, {&options, 1},
             [&](std::size_t, Image rows, double) { appendRows(rows, picture); });
  return picture;
}

void OffscreenRenderer::renderRows(
    std::vector<SurfaceChunk> chunks, const SceneLattice& lattice,
    std::span<const RenderOptions> options,
    const std::function<void(std::size_t picture, Image rows, double share)>& take) {
  std::vector<SceneWithNotes> scenes = scenesOf(options, lattice, [&](auto&& f) {
    for (const SurfaceChunk& chunk : chunks)
      for (const SurfaceVertex& vertex : chunk.vertices)
        f(lattice.toWorld(chunk.origin + glm::dvec3(vertex.position)));
  });
  context_->renderEach(std::move(chunks), std::move(scenes), take);
}

const std::string& OffscreenRenderer::deviceName() const { return context_->deviceName(); }

}  // namespace isobrick
