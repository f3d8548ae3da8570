#include "isobrick/viewer/serve/client_message.h"

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Whole numbers that a double holds.
constexpr double kMostCount = 9007199254740992.0;

std::optional<std::uint64_t> countOf(const Asked& asked, const char* name) {
  const auto number = asked.clamped(name, 0.0, kMostCount);
  return number ? std::optional(static_cast<std::uint64_t>(*number)) : std::nullopt;
}

ViewPoint viewOf(const Asked& asked) {
  ViewPoint view;
  const auto eye = asked.point("eye");
  if (!eye) throw Error("'eye' is not there");
  view.eye = *eye;
  view.pixels_per_radian = asked.needed("pixels_per_radian", 1.0, 1e6);
  view.pixels_per_unit = asked.clamped("pixels_per_unit", 1e-9, 1e9);
  view.pixels = asked.clamped("pixels", 0.1, 1000.0).value_or(1.0);
  return view;
}

ClientWish clientWishOf(const Asked& asked, const ViewVolume& volume) {
  ClientWish result;
  result.number = static_cast<std::int64_t>(asked.needed("wish", 0.0, kMostCount));
  result.most_triangles = countOf(asked, "most_triangles");
  result.most_bytes = countOf(asked, "most_bytes");
  SurfaceWish& wish = result.surfaces;
  for (const Asked& one : asked.objects("surfaces", kMostWishedSurfaces)) {
    SurfaceWish::Surface& surface = wish.surfaces.emplace_back();
    surface.isovalue = one.needed("iso", volume.least_value, volume.greatest_value);
    surface.visible = one.flag("visible").value_or(true);
    surface.inside = askedInside(one);
  }
  const glm::dvec3 far(1 << 30);  // it may be in another volume of the scene
  const auto focus = asked.point("focus");
  wish.is_whole = !focus;
  wish.detail.focus =
      focus ? glm::clamp(*focus, -far, far) : 0.5 * glm::dvec3(volume.voxels - Index3(1));
  wish.radius = focus ? asked.needed("radius", 1.0, volume.diagonal()) : volume.diagonal();
  wish.detail.curvature_tolerance = asked.clamped("curvature", 0.0, 1e6);
  if (const auto view = asked.object("view")) wish.detail.view = viewOf(*view);
  wish.detail.capped = asked.flag("cap").value_or(false);
  wish.detail.region = askedRegion(asked);
  return result;
}

}  // namespace

InsideOf askedInside(const Asked& asked) {
  const std::string name = asked.text("inside");
  if (name.empty() || name == "above") return InsideOf::kAbove;
  if (name != "below") throw Error("'inside' is neither above nor below");
  return InsideOf::kBelow;
}

ViewRegion askedRegion(const Asked& asked) {
  ViewRegion region;
  for (const glm::dvec4& plane : asked.quadruples("clip")) {
    region.half_spaces.push_back({glm::dvec3(plane), plane.w});
    if (!(glm::length(region.half_spaces.back().normal) > 0.0))
      throw Error("'clip' has a normal of 0,0,0");
  }
  for (const glm::dvec4& sphere : asked.quadruples("sphere")) {
    region.balls.push_back({glm::dvec3(sphere), sphere.w});
    if (!(sphere.w > 0.0)) throw Error("'sphere' has a radius that is not above 0");
  }
  return region;
}

ClientMessage parseClientMessage(const Asked& asked, const ViewVolume& volume) {
  const std::string type = asked.text("type");
  if (type.empty()) throw Error("the message has no 'type'");
  if (type == "wish") return clientWishOf(asked, volume);
  if (type == "shown")
    return ClientShown{static_cast<std::uint64_t>(asked.needed("pass", 0.0, kMostCount)),
                       asked.needed("seconds", 0.0, 10.0)};
  return {};
}

}  // namespace isobrick
