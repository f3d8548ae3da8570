// The camera of the interactive viewer: a plain struct, and functions that give the next one.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "isobrick/viewer/placed_camera.h"

namespace isobrick {

// Turns about a pivot. In the patient's coordinates of medical volumes (+x left, +y back, +z head)
// azimuth 0 and elevation 0 look along +y: a portrait of the face.
struct ViewCamera {
  glm::dvec3 pivot{0.0};       // world; in the middle of the picture
  double distance = 1.0;       // from the eye to the pivot, world units; 0: see isPlaced()
  double azimuth = 25.0;       // degrees, -180 .. 180
  double elevation = 15.0;     // degrees, -90 .. 90
  double vertical_fov = 30.0;  // degrees, 1 .. 150
  bool orthographic = false;   // as large as the perspective picture is at the pivot

  bool operator==(const ViewCamera&) const = default;
};

// False for a camera of a saved view that says no distance: ViewSession::show() frames it.
inline bool isPlaced(const ViewCamera& camera) { return camera.distance > 0.0; }

// `aspect` is width / height of the picture.
PlacedCamera placeCamera(const ViewCamera& camera, double aspect);

// From `eye` to `target`, which is the pivot; +y is up if that is straight above or below.
ViewCamera lookingAt(const glm::dvec3& eye, const glm::dvec3& target);

// The same direction, from a place that sees the whole box; the pivot is its middle.
ViewCamera framed(const ViewCamera& camera, const WorldBox& box, double aspect);

// The place of the eye, without turning it, at which the points just fill the picture, but for a
// margin: they lie in the middle of both directions and touch the border in one.
class CameraFit {
 public:
  // `aspect` is width / height of the picture. Perspective alone.
  CameraFit(const ViewCamera& camera, double aspect);
  void include(const glm::dvec3& point);
  // With the pivot as far away as the middle of the points; while none was included, as it was.
  ViewCamera fitted() const;

 private:
  ViewCamera camera_;
  PlacedCamera axes_;
  double half_width_, half_height_;
  glm::dvec4 beyond_;  // of the points at the right, left, upper and lower border
  WorldBox box_ = emptyWorldBox();
  double nearest_;
};

// Turned about the pivot, to the right and up. Elevation stops at the poles.
ViewCamera orbited(const ViewCamera& camera, double azimuth_degrees, double elevation_degrees);

// Moved so that points in the pivot's plane move by `shift` (normalised device coordinates).
ViewCamera panned(const ViewCamera& camera, const glm::dvec2& shift, double aspect);

// The distance times `factor` (> 0), with the point of the pivot's plane under `cursor` (normalised
// device coordinates) staying where it is in the picture. `least` and `greatest` bound the
// distance.
ViewCamera zoomed(const ViewCamera& camera, double factor, const glm::dvec2& cursor, double aspect,
                  double least, double greatest);

// The same eye with another direction: to the right and up.
ViewCamera lookedAround(const ViewCamera& camera, double azimuth_degrees, double elevation_degrees);

// Eye and pivot moved along the camera's right, up and forward axes, in world units.
ViewCamera flown(const ViewCamera& camera, const glm::dvec3& right_up_forward);

// The same direction and distance, with `pivot` in the middle of the picture and turned about.
ViewCamera turningAbout(const ViewCamera& camera, const glm::dvec3& pivot);

// From the front (-y), right (+x) or top (+z), or from the opposite sides.
enum class AxisView { kFront, kBack, kRight, kLeft, kTop, kBottom };
ViewCamera alongAxis(const ViewCamera& camera, AxisView view);

}  // namespace isobrick
