#include "isobrick/viewer/view_picture.h"

#include <chrono>
#include <limits>
#include <thread>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/notes/draw_notes.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"

namespace isobrick {

Image pictureOf(ViewSession& session, const glm::dvec2& size, int times, bool layers) {
  Image image = session.picture(size, times, layers);
  const ViewCamera& camera = session.state().camera;
  drawNotes(
      session.notes(),
      placeCamera(camera, static_cast<double>(image.width) / static_cast<double>(image.height)),
      camera.distance, image);
  return image;
}

ViewPicture drawView(std::shared_ptr<const Pyramid> pyramid, const ViewState& state,
                     const ViewDrawing& drawing, const CancelFlag& cancel) {
  ViewPicture picture;
  drawViews(std::move(pyramid), {&state, 1}, drawing, cancel,
            [&](ViewPicture drawn) { picture = std::move(drawn); });
  return picture;
}

void drawViews(std::shared_ptr<const Pyramid> pyramid, std::span<const ViewState> states,
               const ViewDrawing& drawing, const CancelFlag& cancel,
               const std::function<void(ViewPicture picture)>& take) {
  const EglContext context;
  const EglContext::CurrentScope current(context);
  GlSceneRenderer renderer;
  const auto [width, height, threads, layers] = drawing;
  if (width < 1 || height < 1 || width > renderer.greatestSize() ||
      height > renderer.greatestSize())
    throw Error("cannot render a picture of " + std::to_string(width) + " x " +
                std::to_string(height) + " pixels: width and height are 1 to " +
                std::to_string(renderer.greatestSize()));
  ViewSession session(std::move(pyramid), renderer,
                      {threads, std::numeric_limits<std::uint64_t>::max()});
  session.apply(InputEvent::resized(width, height), 0.0, false);
  double clock = 0.0;  // nothing moves: any clock does
  for (const ViewState& state : states) {
    session.show(state);
    do {
      cancel.check();
      session.update(clock += 1.0);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    } while (!session.settled());
    const SessionStatus status = session.status();
    if (!status.error.empty()) throw Error(status.error);
    take({pictureOf(session, {width, height}, 1, layers), status.triangles, renderer.deviceName()});
  }
}

}  // namespace isobrick
