#include "isobrick/viewer/view_picture.h"

#include <chrono>
#include <limits>
#include <thread>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"

namespace isobrick {

SceneWithNotes pictureSceneOf(const ViewSession& session, int width, int height, bool layers) {
  SceneWithNotes scene;
  scene.frame = session.pictureFrame(width, height);
  scene.frame.pixel_scale = lineScaleOf(width, height);
  scene.layers = layers;
  scene.notes = session.notes();
  scene.target_distance = session.state().camera.distance;
  return scene;
}

ViewPicture drawView(std::shared_ptr<const Pyramid> pyramid, const ViewState& state,
                     const ViewDrawing& drawing, const CancelFlag& cancel) {
  ViewPicture picture;
  drawViews(std::move(pyramid), {&state, 1}, drawing, cancel, [&](ViewRows rows) {
    appendRows(rows.rows, picture.image);
    picture.triangles = rows.triangles;
    picture.device = rows.device;
  });
  return picture;
}

void drawViews(std::shared_ptr<const Pyramid> pyramid, std::span<const ViewState> states,
               const ViewDrawing& drawing, const CancelFlag& cancel,
               const std::function<void(ViewRows rows)>& take) {
  const auto [width, height, threads, layers] = drawing;
  checkPictureSize(width, height);
  const EglContext context;
  const EglContext::CurrentScope current(context);
  GlSceneRenderer renderer;
  ViewSession session(std::move(pyramid), renderer,
                      {threads, std::numeric_limits<std::uint64_t>::max()});
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
    PictureTiles tiles(renderer, pictureSceneOf(session, width, height, layers));
    while (!tiles.done()) {
      cancel.check();
      std::optional<Image> rows = tiles.drawNext();
      if (rows)
        take({i, tiles.shape(), std::move(*rows), tiles.share(), status.triangles,
              renderer.deviceName()});
    }
  }
}

}  // namespace isobrick
