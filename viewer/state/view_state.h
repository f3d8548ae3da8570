// The state of the viewer: everything that a saved view brings back, as plain structs.
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/color_map.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/surface_region.h"
#include "isobrick/storage/grid.h"
#include "isobrick/storage/value_transform.h"
#include "isobrick/viewer/state/measurement.h"
#include "isobrick/viewer/state/view_camera.h"

namespace isobrick {

class ListedComponents;  // stream/listed_components.h

// Colours are sRGB values 0..1.
struct ViewSurface {
  double isovalue = 0.0;  // data units
  glm::vec3 color{0.90f, 0.86f, 0.79f};
  double opacity = 1.0;  // 0 .. 1
  bool visible = true;
  PieceChoice pieces = {};  // that are shown of it
  InsideOf inside = InsideOf::kAbove;
  int volume = 0;  // that it is of: 0 the view's own, then those beside it

  bool operator==(const ViewSurface&) const = default;
};

// The sphere of interest (Sect. 5.1 of the paper).
struct ViewFocus {
  glm::dvec3 center{0.0};   // voxel indices
  double radius = 32.0;     // voxels, > 0
  bool everywhere = false;  // the finest level everywhere; the centre only sets where it begins
  bool show_sphere = true;
  bool follow_view = false;  // the centre is the camera's pivot

  bool operator==(const ViewFocus&) const = default;
};

// Points with dot(normal, point) >= offset stay.
struct ViewClipPlane {
  glm::dvec3 normal{1.0, 0.0, 0.0};  // world, unit
  double offset = 0.0;               // world units
  bool enabled = true;
  bool cap = true;  // the cut shows the volume's values inside the surface

  bool operator==(const ViewClipPlane&) const = default;
};
inline constexpr std::size_t kMostClipPlanes = 6;

struct ViewBall {
  glm::dvec3 center{0.0};
  double radius = 1.0;  // above 0

  bool operator==(const ViewBall&) const = default;
};

struct ViewMask {
  std::string path;             // of the volume, as the user named it
  std::optional<double> value;  // RegionMask::value

  bool operator==(const ViewMask&) const = default;
};

// Surfaces are shown within all of these alone, open where they end (SurfaceRegion); in voxel
// indices of each volume.
struct ViewRegion {
  std::vector<HalfSpace> half_spaces;
  std::vector<ViewBall> balls;
  std::vector<ViewMask> masks;

  bool operator==(const ViewRegion&) const = default;
  bool isEverywhere() const { return half_spaces.empty() && balls.empty() && masks.empty(); }
};

// The volumes of masks that are open, by the paths of views.
using OpenMasks = std::map<std::string, std::shared_ptr<const Pyramid>>;

// The path of a mask that is not open; empty: there is none.
std::string missingMask(const ViewRegion& region, const OpenMasks& open);
// Leaves out the masks that are not open. `step`: voxels to an index of the result.
SurfaceRegion surfaceRegionOf(const ViewRegion& region, const OpenMasks& open, double step);

// A slice through the volume, across one axis of its voxels.
struct ViewSlice {
  bool shown = false;
  double position = 0.0;  // voxel index along the axis

  bool operator==(const ViewSlice&) const = default;
};

// The three slices in views of their own beside the scene (slice_view.h). They share how near and
// where.
inline constexpr double kLeastSliceZoom = 0.5, kMostSliceZoom = 200.0;
struct ViewSliceViews {
  bool shown = false;
  double zoom = 1.0;                 // 1: all of the slice; kLeastSliceZoom .. kMostSliceZoom
  std::optional<glm::dvec3> center;  // voxel index; none: the middle of the volume

  bool operator==(const ViewSliceViews&) const = default;
};

inline constexpr int kMostPictureTimes = 16;
// The form of pictures of the view, beside the window.
struct ViewPictures {
  bool transparent = false;  // no background
  int times = 1;  // as many pixels as the window, along both sides; 1 .. kMostPictureTimes
  bool scale_bar = false, axes = false, legend = false;  // PictureNotes

  bool operator==(const ViewPictures&) const = default;
};

enum class ViewColoring { kPlain, kLevel, kGradient, kOther, kPlaneDistance, kComponent };

// A plane to measure from: dot(normal, point) - offset, above 0 on the normal's side.
struct ViewPlane {
  glm::dvec3 normal{0.0, 0.0, 1.0};  // world, unit
  double offset = 0.0;               // world units

  bool operator==(const ViewPlane&) const = default;
};

// The meaning of the colours of values. A window: the values of the first and the last colour.
struct ViewValues {
  ColorMap map = ColorMap::kViridis;
  // Data units per world unit; none: from 0 to a quarter of the greatest there could be.
  std::optional<std::array<double, 2>> gradient_window;
  std::string other;  // the path of the pyramid for ViewColoring::kOther
  std::optional<std::array<double, 2>> other_window;  // its data units; none: all of its values
  ViewPlane plane;                                    // for ViewColoring::kPlaneDistance
  std::optional<std::array<double, 2>> plane_window;  // world units; none: all of the volume
  // Of the first and of the last colour, 0 .. 1; those between follow. Surfaces have theirs beside.
  std::array<double, 2> opacity{1.0, 1.0};

  bool operator==(const ViewValues&) const = default;
};
enum class ViewLighting { kThreeLights, kHeadlight };

struct ViewState {
  ViewCamera camera;
  std::vector<ViewSurface> surfaces = std::vector<ViewSurface>(1);  // at least one
  int active_surface = 0;  // which one keys and the slider move
  ViewFocus focus;
  int step = 0;  // of time, if the volume has several (session/time_steps.h)
  std::optional<double> curvature_tolerance;  // Query::curvature_tolerance
  std::optional<double> view_pixels;          // ViewPoint::pixels, seen from the camera
  std::vector<ViewClipPlane> clip_planes;     // at most kMostClipPlanes
  ViewRegion region;
  std::array<ViewSlice, 3> slices;  // across x, y and z
  ViewSliceViews slice_views;
  double slice_opacity = 1.0;             // 0 .. 1
  std::optional<double> slice_threshold;  // data units; slices leave out what is below
  std::array<double, 2> value_window{0.0,
                                     1.0};  // data units that caps and slices show black, white
  ViewColoring coloring = ViewColoring::kPlain;
  ViewValues values;
  ViewLighting lighting = ViewLighting::kThreeLights;
  bool ambient_occlusion = false;  // surfaces shade each other, by their depths in the picture
  bool shadow = false;  // surfaces keep the key light from each other; not with the headlight
  ViewPictures pictures;
  std::vector<ViewMeasurement> measurements;     // at most kMostMeasurements, shown in the scene
  std::vector<ViewPieceMeasure> piece_measures;  // at most kMostPieceMeasures
  bool capped = false;  // surfaces are closed at the border of the volume (Query::cap)
  // Mesh files are simplified within this distance, voxels (SimplifyOptions::distance).
  std::optional<double> mesh_distance;
  bool wireframe = false;
  bool show_transitions = false;  // cells that join two levels in a colour of their own
  bool show_box = true;
  bool show_handles = true;  // arrows at focus and clip planes, in the window alone
  glm::vec3 background_top{0.36f, 0.38f, 0.41f};
  glm::vec3 background_bottom{0.16f, 0.17f, 0.19f};

  bool operator==(const ViewState&) const = default;
};

inline ViewSurface& activeSurface(ViewState& state) {
  return state.surfaces[static_cast<std::size_t>(state.active_surface)];
}
inline const ViewSurface& activeSurface(const ViewState& state) {
  return state.surfaces[static_cast<std::size_t>(state.active_surface)];
}

// Not the last one. The active one stays active, unless it goes itself.
void removeSurface(std::size_t surface, ViewState& state);

struct ViewVolume {
  Index3 voxels{2, 2, 2};
  GridGeometry geometry;
  double least_value = 0.0;
  double greatest_value = 1.0;
  ValueTransform stored_values;   // from the numbers of slices to values
  bool has_all_values = true;     // false: there may be others than from the least to the greatest
  std::vector<double> isovalues;  // that are suggested, the best one first; none of equal voxels

  WorldBox box() const;
  WorldBox boxAround(const glm::dvec3& lower, const glm::dvec3& upper) const;
  // Voxels from any point of the volume to the furthest.
  double diagonal() const;
};

// The view that a volume opens with before any of it is shown (session/opening_view.h): the volume
// framed from the front, all of the surface fine, the focus in the middle.
ViewState firstView(const ViewVolume& volume, double aspect);

// `state`, from the user or a file, with every number in its range, and the focus on the pivot if
// it follows the view. Bounds once more change nothing.
ViewState bounded(const ViewState& state, const ViewVolume& volume);

double wantedRadius(const ViewState& state, const ViewVolume& volume);

// All that the triangles of a view, and the values at their vertices, follow from: equal wishes
// have equal chunks.
struct SurfaceWish {
  struct Surface {
    double isovalue = 0.0;
    PieceChoice pieces = {};
    bool visible = true;
    std::shared_ptr<const ListedComponents> listed = {};  // that it is coloured by; null: none
    InsideOf inside = InsideOf::kAbove;

    bool operator==(const Surface&) const = default;
  };
  // Of all surfaces, but for how far they are fine.
  struct Detail {
    glm::dvec3 focus{0.0};  // voxel indices
    std::optional<double> curvature_tolerance;
    std::optional<ViewPoint> view;
    ViewColoring values = ViewColoring::kPlain;  // that vertices carry: kGradient, kOther, or none
    std::string other;                           // the path of the pyramid of kOther
    bool capped = false;                         // Query::cap
    ViewRegion region = {};

    bool operator==(const Detail&) const = default;
  };
  std::vector<Surface> surfaces;
  Detail detail;
  double radius = 0.0;  // at rest, voxels
  // The user chose no focus: a surface that is coarser than wanted is of one level everywhere. It
  // changes nothing that is shown at rest.
  bool is_whole = false;

  // The same without colours of pieces.
  SurfaceWish withoutLists() const;
  bool operator==(const SurfaceWish& other) const {
    return surfaces == other.surfaces && detail == other.detail && radius == other.radius;
  }
};

// `height`: of the picture, pixels; counts if the view sets how fine the surface shall be.
SurfaceWish wishOf(const ViewState& state, const ViewVolume& volume, double height);

// Surfaces within the radius `radius`; beyond the volume's diagonal the whole of level 0.
Query queryOf(const SurfaceWish& wish, const ViewVolume& volume, std::size_t surface,
              double radius);

}  // namespace isobrick
