#include "isobrick/viewer/state/scene_handles.h"

#include <algorithm>
#include <glm/geometric.hpp>

namespace isobrick {
namespace {

// In pixels of an ordinary screen.
constexpr double kFocusArmPixels = 70.0;
constexpr double kPlaneArmPixels = 110.0;  // past that of a focus in the plane
constexpr double kGripPixels = 9.0;
constexpr double kShortestArmPixels = 15.0;
constexpr double kCubePixels = 20.0;  // half an edge
constexpr double kCubePlace = 56.0;   // of its middle, from both borders
constexpr double kLeastPicture = 260.0;

PlacedCamera placedIn(const ViewCamera& camera, const PictureSize& picture) {
  return placeCamera(camera, picture.pixels.x / picture.pixels.y);
}

}  // namespace

std::optional<glm::dvec2> pixelOf(const PlacedCamera& camera, const glm::dvec2& picture,
                                  const glm::dvec3& world) {
  const glm::dvec3 arm = world - camera.eye;
  const double along = glm::dot(arm, camera.forward);
  if (!camera.orthographic && along <= 0.0) return std::nullopt;
  const double reach = camera.orthographic ? 1.0 : along;
  const glm::dvec2 place(glm::dot(arm, camera.right) / (camera.half_width * reach),
                         glm::dot(arm, camera.up) / (camera.half_height * reach));
  return glm::dvec2(0.5 + 0.5 * place.x, 0.5 - 0.5 * place.y) * picture;
}

PixelPath pathOf(const PlacedCamera& camera, const glm::dvec2& picture,
                 const std::vector<glm::dvec3>& world) {
  constexpr double kLeast = 1e-4;  // from the eye, of the distance of the farther end
  const auto away = [&](const glm::dvec3& point) {
    return glm::dot(point - camera.eye, camera.forward);
  };
  PixelPath path;
  for (const glm::dvec3& point : world)
    if (const auto pixel = pixelOf(camera, picture, point)) path.points.push_back(*pixel);
  for (std::size_t i = 0; i + 1 < world.size(); ++i) {
    std::array<glm::dvec3, 2> ends{world[i], world[i + 1]};
    const std::array<double, 2> distances{away(ends[0]), away(ends[1])};
    const double least = kLeast * std::max(distances[0], distances[1]);
    for (std::size_t end = 0; end < 2 && !camera.orthographic; ++end)
      if (distances[end] < least)
        ends[end] += (least - distances[end]) / (distances[1 - end] - distances[end]) *
                     (world[i + 1 - end] - world[i + end]);
    const auto from = pixelOf(camera, picture, ends[0]), to = pixelOf(camera, picture, ends[1]);
    if (from && to) path.lines.push_back({*from, *to});
  }
  return path;
}

std::vector<SceneHandle> handlesOf(const ViewState& state, const ViewVolume& volume,
                                   const PictureSize& picture) {
  std::vector<SceneHandle> handles;
  if (!state.show_handles || picture.pixels.x < 1.0 || picture.pixels.y < 1.0) return handles;
  const PlacedCamera camera = placedIn(state.camera, picture);
  const auto add = [&](SceneHandle handle) {
    const double reach =
        camera.orthographic ? 1.0 : glm::dot(handle.foot - camera.eye, camera.forward);
    const double per_pixel = 2.0 * camera.half_height * reach / picture.pixels.y;
    const double pixels =
        handle.kind == SceneHandle::Kind::kFocus ? kFocusArmPixels : kPlaneArmPixels;
    const double arm = handle.kind == SceneHandle::Kind::kRadius
                           ? state.focus.radius * volume.geometry.leastSpacing()
                           : pixels * picture.scale * per_pixel;
    const auto foot = pixelOf(camera, picture.pixels, handle.foot);
    const auto tip = pixelOf(camera, picture.pixels, handle.foot + handle.direction * arm);
    if (!foot || !tip || glm::distance(*foot, *tip) < kShortestArmPixels * picture.scale) return;
    handle.foot_pixel = *foot;
    handle.tip = *tip;
    handles.push_back(handle);
  };
  if (!state.focus.everywhere) {
    const glm::dmat3 matrix = volume.geometry.indexToWorldMatrix();
    for (int axis = 0; axis < 3; ++axis)
      add({SceneHandle::Kind::kFocus, axis, volume.geometry.indexToWorld(state.focus.center),
           glm::normalize(matrix[axis])});
    // On the sphere's rim, between the arrows of most views.
    if (state.focus.show_sphere)
      add({SceneHandle::Kind::kRadius, 0, volume.geometry.indexToWorld(state.focus.center),
           glm::normalize(camera.right - camera.up)});
  }
  const glm::dvec3 middle = volume.box().center();
  for (std::size_t i = 0; i < state.clip_planes.size(); ++i) {
    const ViewClipPlane& plane = state.clip_planes[i];
    if (!plane.enabled) continue;
    const double away = plane.offset - glm::dot(plane.normal, middle);
    add({SceneHandle::Kind::kClipPlane, static_cast<int>(i), middle + plane.normal * away,
         plane.normal});
  }
  return handles;
}

std::optional<SceneHandle> handleAt(const std::vector<SceneHandle>& handles,
                                    const glm::dvec2& cursor, double scale) {
  std::optional<SceneHandle> nearest;
  double least = kGripPixels * scale;
  for (const SceneHandle& handle : handles) {
    const double away = glm::distance(handle.tip, cursor);
    if (away > least) continue;
    least = away;
    nearest = handle;
  }
  return nearest;
}

std::optional<double> pullOf(const SceneHandle& handle, const ViewCamera& camera,
                             const PictureSize& picture, const glm::dvec2& cursor) {
  const glm::dvec2 place = cursor / picture.pixels * glm::dvec2(2.0, -2.0) + glm::dvec2(-1.0, 1.0);
  const PictureRay ray = rayThrough(placedIn(camera, picture), place);
  // The point of the handle's line that is nearest to the ray.
  const glm::dvec3 arm = handle.foot - ray.origin;
  const double mixed = glm::dot(handle.direction, ray.direction);
  const double square = glm::dot(ray.direction, ray.direction);
  const double apart = square - mixed * mixed;
  if (apart < 1e-6 * square) return std::nullopt;
  return (mixed * glm::dot(ray.direction, arm) - square * glm::dot(handle.direction, arm)) / apart;
}

void pull(const SceneHandle& handle, double by, const ViewVolume& volume, ViewState& state) {
  const glm::dvec3 to = handle.foot + handle.direction * by;
  if (handle.kind == SceneHandle::Kind::kFocus) {
    state.focus.center = volume.geometry.worldToIndex(to);
    state.focus.follow_view = false;
  } else if (handle.kind == SceneHandle::Kind::kRadius) {
    state.focus.radius = by / volume.geometry.leastSpacing();
  } else {
    const auto number = static_cast<std::size_t>(handle.number);
    if (number >= state.clip_planes.size()) return;
    state.clip_planes[number].offset = glm::dot(state.clip_planes[number].normal, to);
  }
  state = bounded(state, volume);
}

std::vector<CubeFace> cubeFacesOf(const ViewCamera& camera, const PictureSize& picture) {
  std::vector<CubeFace> faces;
  if (std::min(picture.pixels.x, picture.pixels.y) < kLeastPicture * picture.scale) return faces;
  const PlacedCamera placed = placedIn(camera, picture);
  const glm::dvec2 middle(picture.pixels.x - kCubePlace * picture.scale,
                          kCubePlace * picture.scale);
  constexpr std::array kViews{AxisView::kLeft, AxisView::kRight,  AxisView::kFront,
                              AxisView::kBack, AxisView::kBottom, AxisView::kTop};
  for (int i = 0; i < 6; ++i) {
    const int axis = i / 2;
    glm::dvec3 normal(0.0), across(0.0), along(0.0);
    normal[axis] = i % 2 == 0 ? -1.0 : 1.0;
    across[(axis + 1) % 3] = 1.0;
    along[(axis + 2) % 3] = 1.0;
    CubeFace face;
    face.view = kViews[static_cast<std::size_t>(i)];
    face.toward = -glm::dot(normal, placed.forward);
    if (face.toward < 1e-6) continue;
    const std::array corners{normal - across - along, normal + across - along,
                             normal + across + along, normal - across + along};
    for (std::size_t c = 0; c < corners.size(); ++c)
      face.corners[c] = middle + kCubePixels * picture.scale *
                                     glm::dvec2(glm::dot(corners[c], placed.right),
                                                -glm::dot(corners[c], placed.up));
    faces.push_back(face);
  }
  return faces;
}

std::optional<AxisView> cubeFaceAt(const std::vector<CubeFace>& faces, const glm::dvec2& cursor) {
  for (const CubeFace& face : faces) {
    int left = 0, right = 0;
    for (std::size_t c = 0; c < 4; ++c) {
      const glm::dvec2 side = face.corners[(c + 1) % 4] - face.corners[c];
      const glm::dvec2 arm = cursor - face.corners[c];
      ++(side.x * arm.y - side.y * arm.x < 0.0 ? left : right);
    }
    if (left == 4 || right == 4) return face.view;
  }
  return std::nullopt;
}

}  // namespace isobrick
