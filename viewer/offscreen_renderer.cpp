#include "isobrick/viewer/offscreen_renderer.h"

#include <chrono>
#include <limits>
#include <set>
#include <thread>
#include <utility>

#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/view_picture.h"

namespace isobrick {
namespace {

void drawRows(SceneRenderer& renderer, SceneWithNotes scene, std::size_t picture,
              std::uint64_t triangles, const CancelFlag& cancel,
              const OffscreenRenderer::TakeRows& take) {
  PictureTiles tiles(renderer, std::move(scene));
  while (!tiles.done()) {
    cancel.check();
    if (std::optional<Image> rows = tiles.drawNext())
      take({picture, tiles.shape(), std::move(*rows), tiles.share(), triangles});
  }
}

// Keeps chunks until it ends.
class KeptSurface {
 public:
  KeptSurface(SceneRenderer& renderer, std::size_t chunks) : renderer_(renderer) {
    ids_.reserve(chunks);
  }
  ~KeptSurface() {
    for (const ChunkId id : ids_) renderer_.release(id);
  }
  KeptSurface(const KeptSurface&) = delete;
  KeptSurface& operator=(const KeptSurface&) = delete;

  void add(const SurfaceChunk& chunk) { ids_.push_back(renderer_.upload(chunk)); }
  const std::vector<ChunkId>& ids() const { return ids_; }

 private:
  SceneRenderer& renderer_;
  std::vector<ChunkId> ids_;
};

}  // namespace

class OffscreenRenderer::Context {
 public:
  Context() {
    const EglContext::CurrentScope current(egl);
    renderer = std::make_unique<GlSceneRenderer>();
  }
  ~Context() {
    const EglContext::CurrentScope current(egl);
    renderer.reset();
  }

  EglContext egl;
  std::unique_ptr<GlSceneRenderer> renderer;
};

OffscreenRenderer::OffscreenRenderer() : context_(std::make_unique<Context>()) {}
OffscreenRenderer::~OffscreenRenderer() = default;

const std::string& OffscreenRenderer::deviceName() const {
  return context_->renderer->deviceName();
}

void OffscreenRenderer::drawViews(std::shared_ptr<const Pyramid> pyramid,
                                  std::span<const ViewState> states, const ViewDrawing& drawing,
                                  const CancelFlag& cancel, const TakeRows& take) {
  const auto& [width, height, threads, layers, beside, is_step, masks] = drawing;
  checkPictureSize(width, height);
  const EglContext::CurrentScope current(context_->egl);
  GlSceneRenderer& renderer = *context_->renderer;
  SessionOptions options{threads, std::numeric_limits<std::uint64_t>::max()};
  options.beside = beside;
  options.is_step = is_step;
  options.masks = masks;
  ViewSession session(std::move(pyramid), renderer, options);
  session.apply(InputEvent::resized(width, height), 0.0, false);
  double clock = 0.0;  // nothing moves: any clock does
  for (std::size_t i = 0; i < states.size(); ++i) {
    session.show(states[i]);
    do {
      cancel.check();
      session.update(clock += 1.0);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    } while (!session.settled());
    const SessionStatus status = session.status();
    if (!status.error.empty()) throw Error(status.error);
    if (session.isOverBudget())
      throw Error(
          "the graphics card has no memory for surfaces as fine as the view asks for; set a "
          "region of interest, or draw with ISOBRICK_GRAPHICS=software");
    drawRows(renderer, pictureSceneOf(session, width, height, layers), i, status.triangles, cancel,
             take);
  }
}

void OffscreenRenderer::drawSurface(DrawableSurface surface, std::span<const ViewState> states,
                                    const ViewDrawing& drawing, const CancelFlag& cancel,
                                    const TakeRows& take) {
  const auto& [width, height, threads, layers, beside, is_step, masks] = drawing;
  checkPictureSize(width, height);
  WorldBox bounds = emptyWorldBox();
  surface.forEachVertex([&](const glm::dvec3& point) { bounds.include(point); });
  std::set<int> found;
  for (const SurfaceChunk& chunk : surface.chunks) found.insert(chunk.level);
  std::vector<LevelCounts> levels;
  for (const int level : found) levels.emplace_back().level = level;
  const EglContext::CurrentScope current(context_->egl);
  KeptSurface kept(*context_->renderer, surface.chunks.size());
  for (SurfaceChunk& chunk : surface.chunks) kept.add(std::exchange(chunk, {}));
  for (std::size_t i = 0; i < states.size(); ++i) {
    const ViewState& state = states[i];
    if (!(state.camera.vertical_fov >= 1.0 && state.camera.vertical_fov <= 150.0))
      throw Error("cannot render with a vertical field of view of " +
                  std::to_string(state.camera.vertical_fov) + " degrees: choose 1 to 150");
    const bool by_piece = state.coloring == ViewColoring::kComponent;
    SceneWithNotes scene;
    scene.frame = sceneOf(state, surface.volume, width, height);
    scene.frame.bounds = bounds;
    scene.frame.fill_sphere = false;
    scene.frame.color_by_component = by_piece;
    scene.frame.pixel_scale = lineScaleOf(width, height);
    scene.frame.chunks = kept.ids();
    scene.layers = layers;
    scene.notes =
        notesOf(state, levels, std::nullopt, surface.volume.geometry.unit, surface.pieces);
    scene.target_distance = state.camera.distance;
    drawRows(*context_->renderer, std::move(scene), i, surface.triangles, cancel, take);
  }
}

}  // namespace isobrick
