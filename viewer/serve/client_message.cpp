#include "isobrick/viewer/serve/client_message.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <nlohmann/json.hpp>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

using MessageJson = nlohmann::json;

[[noreturn]] void refuseMember(const char* name, const char* what) {
  throw Error(std::string("'") + name + "' of the message is not " + what);
}

const MessageJson* member(const MessageJson& json, const char* name) {
  const auto found = json.find(name);
  return found == json.end() || found->is_null() ? nullptr : &*found;
}

std::optional<double> numberIn(const MessageJson& json, const char* name, double least,
                               double most) {
  const MessageJson* const value = member(json, name);
  if (value == nullptr) return std::nullopt;
  if (!value->is_number()) refuseMember(name, "a number");
  return std::clamp(value->get<double>(), least, most);
}

double neededNumber(const MessageJson& json, const char* name, double least, double most) {
  const auto number = numberIn(json, name, least, most);
  if (!number) refuseMember(name, "there");
  return *number;
}

std::optional<glm::dvec3> pointIn(const MessageJson& json, const char* name) {
  const MessageJson* const value = member(json, name);
  if (value == nullptr) return std::nullopt;
  const bool is_point =
      value->is_array() && value->size() == 3 &&
      std::all_of(value->begin(), value->end(), [](const auto& v) { return v.is_number(); });
  if (!is_point) refuseMember(name, "three numbers");
  constexpr double kFar = 1e12;  // squares and products of such numbers are finite
  return glm::clamp(
      glm::dvec3((*value)[0].get<double>(), (*value)[1].get<double>(), (*value)[2].get<double>()),
      glm::dvec3(-kFar), glm::dvec3(kFar));
}

// Whole numbers that a double holds.
constexpr double kMostCount = 9007199254740992.0;

std::optional<std::uint64_t> countIn(const MessageJson& json, const char* name) {
  const auto number = numberIn(json, name, 0.0, kMostCount);
  return number ? std::optional(static_cast<std::uint64_t>(*number)) : std::nullopt;
}

SurfaceWish::Surface surfaceOf(const MessageJson& json, const ViewVolume& volume) {
  if (!json.is_object()) refuseMember("surfaces", "a list of objects");
  SurfaceWish::Surface surface;
  surface.isovalue = neededNumber(json, "iso", volume.least_value, volume.greatest_value);
  if (const MessageJson* const visible = member(json, "visible")) {
    if (!visible->is_boolean()) refuseMember("visible", "true or false");
    surface.visible = visible->get<bool>();
  }
  return surface;
}

ViewPoint viewOf(const MessageJson& json) {
  if (!json.is_object()) refuseMember("view", "an object");
  const auto eye = pointIn(json, "eye");
  if (!eye) refuseMember("eye", "there");
  ViewPoint view;
  view.eye = *eye;
  view.pixels_per_radian = neededNumber(json, "pixels_per_radian", 1.0, 1e6);
  view.pixels_per_unit = numberIn(json, "pixels_per_unit", 1e-9, 1e9);
  view.pixels = numberIn(json, "pixels", 0.1, 1000.0).value_or(1.0);
  return view;
}

ClientWish wishIn(const MessageJson& json, const ViewVolume& volume) {
  ClientWish result;
  result.number = static_cast<std::int64_t>(neededNumber(json, "wish", 0.0, kMostCount));
  result.most_triangles = countIn(json, "most_triangles");
  result.most_bytes = countIn(json, "most_bytes");
  SurfaceWish& wish = result.surfaces;
  const MessageJson* const surfaces = member(json, "surfaces");
  if (surfaces == nullptr || !surfaces->is_array() || surfaces->empty() ||
      surfaces->size() > kMostWishedSurfaces)
    refuseMember("surfaces", "a list of 1 to 8 objects");
  for (const MessageJson& surface : *surfaces) wish.surfaces.push_back(surfaceOf(surface, volume));
  const glm::dvec3 last(volume.voxels - Index3(1));
  const auto focus = pointIn(json, "focus");
  wish.is_whole = !focus;
  wish.detail.focus = focus ? glm::clamp(*focus, glm::dvec3(0.0), last) : 0.5 * last;
  wish.radius = focus ? neededNumber(json, "radius", 1.0, volume.diagonal()) : volume.diagonal();
  wish.detail.curvature_tolerance = numberIn(json, "curvature", 0.0, 1e6);
  if (const MessageJson* const view = member(json, "view")) wish.detail.view = viewOf(*view);
  return result;
}

}  // namespace

ClientMessage parseClientMessage(std::string_view text, const ViewVolume& volume) {
  if (text.size() > kMostMessageBytes) throw Error("the message is too long");
  const MessageJson json = MessageJson::parse(text, nullptr, false);
  const MessageJson* const type = json.is_object() ? member(json, "type") : nullptr;
  if (type == nullptr || !type->is_string())
    throw Error("the message is no JSON object with a 'type'");
  if (*type == "wish") return wishIn(json, volume);
  if (*type == "shown")
    return ClientShown{static_cast<std::uint64_t>(neededNumber(json, "pass", 0.0, kMostCount)),
                       neededNumber(json, "seconds", 0.0, 10.0)};
  return {};
}

}  // namespace isobrick
