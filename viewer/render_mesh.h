// The picture of a mesh: its chunks, and the camera from the options to the place of the eye,
// without OpenGL.
#pragma once

#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/placed_camera.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// A mesh of world positions as chunks of at most 2^18 triangles, with a common origin. Triangles
// are sorted by their levels if `with_levels`. The scene's lattice is the world itself.
std::vector<SurfaceChunk> chunksOf(const RenderMesh& mesh, bool with_levels);

// The place of an eye, without turning it, at which the points just fill the picture, but for a
// margin: they lie in the middle of both directions and touch the border in one.
class PictureFit {
 public:
  explicit PictureFit(const PlacedCamera& camera);
  void include(const glm::dvec3& point);
  // Leaves the eye where it is while no point was included.
  void moveEye(PlacedCamera& camera) const;

 private:
  PlacedCamera camera_;
  double half_width_, half_height_;
  double right_, left_, top_, bottom_, nearest_;
};

// The camera of `options` for a picture of the options' shape: in its place if it looks at a
// target, else at the origin with the directions of the orbit. Sizes and field of view must be in
// their ranges. Throws Error if eye and target coincide, `up` is zero or parallel to the view, or
// the eye, a direction or an angle is not finite.
PlacedCamera aimCamera(const RenderOptions& options);

// The same in its place: an OrbitCamera frames its box, or, if it has none, all points that
// forEachPoint(f) passes to f(glm::dvec3); with nothing to frame the eye stays at the origin.
template <typename ForEachPoint>
PlacedCamera placeCamera(const RenderOptions& options, ForEachPoint&& forEachPoint) {
  PlacedCamera camera = aimCamera(options);
  if (options.look_at) return camera;
  PictureFit fit(camera);
  const WorldBox box = options.orbit.box ? WorldBox{glm::dvec3(options.orbit.box->lower),
                                                    glm::dvec3(options.orbit.box->upper)}
                                         : emptyWorldBox();
  if (!box.empty()) {
    for (const glm::dvec3& corner : cornersOf(box)) fit.include(corner);
  } else {
    forEachPoint([&](const glm::dvec3& point) { fit.include(point); });
  }
  fit.moveEye(camera);
  return camera;
}

// The least box that holds the positions; an empty one (RenderBox) if there are none.
RenderBox boundsOf(std::span<const glm::vec3> positions);

}  // namespace isobrick
