#include "isobrick/viewer/state/view_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>
#include <type_traits>
#include <utility>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/nesting.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

std::string readTextFile(const std::string& path, const char* what) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (!file || !(text << file.rdbuf()))
    throw Error("cannot read the " + std::string(what) + " '" + path + "'; is it there?", {path});
  return text.str();
}

namespace {

using OrderedJson = nlohmann::ordered_json;

// Calls f(name, field) for each; `names` are those of the fields, with commas between them.
template <typename F, typename... Values>
void visitFields(std::string_view names, F&& f, Values&... values) {
  const auto next = [&] {
    names.remove_prefix(std::min(names.find_first_not_of(" ,"), names.size()));
    const std::string name(names.substr(0, names.find(',')));
    names.remove_prefix(name.size());
    return name;
  };
  (f(next(), values), ...);
}

// The fields of a struct, by name, in their order. The structured bindings do not compile once the
// struct has another number of fields, so none can be forgotten here.
#define ISOBRICK_FIELDS(Type, ...)                      \
  template <typename T, typename F>                     \
  requires std::is_same_v<std::remove_const_t<T>, Type> \
  void forEachField(T& fields, F&& f) {                 \
    auto& [__VA_ARGS__] = fields;                       \
    visitFields(#__VA_ARGS__, f, __VA_ARGS__);          \
  }

ISOBRICK_FIELDS(ViewCamera, pivot, distance, azimuth, elevation, vertical_fov, orthographic)
ISOBRICK_FIELDS(ComponentSeed, point, area)
ISOBRICK_FIELDS(PieceChoice, keep, hide, least_area)
ISOBRICK_FIELDS(ViewPieceMeasure, isovalue, level, area, volume, lower, upper, center, point)
ISOBRICK_FIELDS(ViewSurface, isovalue, color, opacity, visible, pieces, inside, volume)
ISOBRICK_FIELDS(ViewFocus, center, radius, everywhere, show_sphere, follow_view)
ISOBRICK_FIELDS(ViewClipPlane, normal, offset, enabled, cap)
ISOBRICK_FIELDS(HalfSpace, normal, offset)
ISOBRICK_FIELDS(ViewBall, center, radius)
ISOBRICK_FIELDS(ViewMask, path, value)
ISOBRICK_FIELDS(ViewRegion, half_spaces, balls, masks)
ISOBRICK_FIELDS(ViewSlice, shown, position)
ISOBRICK_FIELDS(ViewSliceViews, shown, zoom, center)
ISOBRICK_FIELDS(ViewPictures, transparent, times, scale_bar, axes, legend)
ISOBRICK_FIELDS(ViewPlane, normal, offset)
ISOBRICK_FIELDS(ViewValues, map, gradient_window, other, other_window, plane, plane_window, opacity)
ISOBRICK_FIELDS(ViewMeasurement, points)
ISOBRICK_FIELDS(ViewState, camera, surfaces, active_surface, focus, step, curvature_tolerance,
                view_pixels, clip_planes, region, slices, slice_views, slice_opacity,
                slice_threshold, value_window, coloring, values, lighting, ambient_occlusion,
                shadow, pictures, measurements, piece_measures, capped, mesh_distance, wireframe,
                show_transitions, show_box, show_handles, background_top, background_bottom)

constexpr std::array<std::string_view, 2> namesOf(InsideOf) { return {"above", "below"}; }
constexpr std::array<std::string_view, 6> namesOf(ViewColoring) {
  return {"plain", "level", "gradient", "other", "plane_distance", "component"};
}
constexpr std::array<std::string_view, 5> namesOf(ColorMap) { return kColorMapNames; }
constexpr std::array<std::string_view, 2> namesOf(ViewLighting) {
  return {"three_lights", "headlight"};
}

template <typename T>
concept Enum = std::is_enum_v<T>;
template <typename T>
concept Number = std::is_same_v<T, double> || std::is_same_v<T, float> || std::is_same_v<T, int>;
template <typename T>
concept Vector3 = std::is_same_v<T, glm::dvec3> || std::is_same_v<T, glm::vec3>;
template <typename T>
concept Fields = requires(T& value) {
  forEachField(value, [](const std::string&, auto&) {});
};

// ----------------------------------------------------------------------------------------- writing

template <typename T>
OrderedJson toJson(const T& value) {
  if constexpr (Enum<T>) {
    return std::string(namesOf(value)[static_cast<std::size_t>(value)]);
  } else if constexpr (Vector3<T>) {
    return OrderedJson{value.x, value.y, value.z};
  } else if constexpr (Fields<const T>) {
    OrderedJson object = OrderedJson::object();
    forEachField(value,
                 [&](const std::string& name, const auto& field) { object[name] = toJson(field); });
    return object;
  } else if constexpr (requires { value.has_value(); }) {
    return value ? toJson(*value) : OrderedJson(nullptr);
  } else if constexpr (std::is_same_v<T, std::string>) {
    return OrderedJson(value);
  } else if constexpr (requires { value.begin(); }) {
    OrderedJson list = OrderedJson::array();
    for (const auto& element : value) list.push_back(toJson(element));
    return list;
  } else {
    return OrderedJson(value);
  }
}

// ----------------------------------------------------------------------------------------- reading

[[noreturn]] void refuse(const std::string& where, const std::string& what) {
  throw Error("the view's '" + where + "' " + what);
}

template <typename T>
void fromJson(const OrderedJson& json, const std::string& where, T& value);

template <typename T>
void listFromJson(const OrderedJson& json, const std::string& where, T& value) {
  if (!json.is_array()) refuse(where, "is not a list");
  if constexpr (requires { value.resize(json.size()); }) {
    constexpr std::size_t kMost = 64;
    if (json.size() > kMost) refuse(where, "has more than 64 elements");
    value.resize(json.size());
  } else if (json.size() != value.size()) {
    refuse(where, "has not " + std::to_string(value.size()) + " elements");
  }
  for (std::size_t i = 0; i < json.size(); ++i)
    fromJson(json[i], where + "[" + std::to_string(i) + "]", value[i]);
}

template <typename T>
void structFromJson(const OrderedJson& json, const std::string& where, T& value) {
  if (!json.is_object()) refuse(where.empty() ? "view" : where, "is not an object");
  const std::string prefix = where.empty() ? "" : where + ".";
  std::size_t known = 0;
  forEachField(value, [&](const std::string& name, auto& field) {
    if (!json.contains(name)) return;
    ++known;
    fromJson(json[name], prefix + name, field);
  });
  if (known == json.size()) return;
  for (const auto& item : json.items()) {
    bool found = false;
    forEachField(value,
                 [&](const std::string& name, auto&) { found = found || item.key() == name; });
    if (!found) refuse(prefix + item.key(), "is not a field that is known here");
  }
}

template <typename T>
void fromJson(const OrderedJson& json, const std::string& where, T& value) {
  if constexpr (Enum<T>) {
    const auto names = namesOf(value);
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (json == std::string(names[i])) {
        value = static_cast<T>(i);
        return;
      }
    }
    std::string known;
    for (const std::string_view name : names)
      known += (known.empty() ? "'" : ", '") + std::string(name) + "'";
    refuse(where, "is none of " + known);
  } else if constexpr (Vector3<T>) {
    std::array<typename T::value_type, 3> list{};
    listFromJson(json, where, list);
    value = {list[0], list[1], list[2]};
  } else if constexpr (Fields<T>) {
    structFromJson(json, where, value);
  } else if constexpr (std::is_same_v<T, bool>) {
    if (!json.is_boolean()) refuse(where, "is neither true nor false");
    value = json.get<bool>();
  } else if constexpr (std::is_same_v<T, std::string>) {
    if (!json.is_string()) refuse(where, "is not a text");
    value = json.get<std::string>();
  } else if constexpr (std::is_same_v<T, int>) {
    if (!json.is_number_integer()) refuse(where, "is not a whole number");
    const auto number = json.get<std::int64_t>();
    if (number < 0 || number > 1000) refuse(where, "is not from 0 to 1000");
    value = static_cast<int>(number);
  } else if constexpr (Number<T>) {
    if (!json.is_number()) refuse(where, "is not a number");
    const double number = json.get<double>();
    constexpr double kMost = 1e30;  // far beyond any volume, and squares stay finite
    if (!(std::abs(number) <= kMost)) refuse(where, "is too large");
    value = static_cast<T>(number);
  } else if constexpr (requires { value.has_value(); }) {
    value.reset();
    if (!json.is_null()) fromJson(json, where, value.emplace());
  } else {
    listFromJson(json, where, value);
  }
}

void checkRanges(const ViewState& state) {
  if (state.camera.distance < 0.0) refuse("camera.distance", "is below 0");
  if (!(state.camera.vertical_fov >= 1.0 && state.camera.vertical_fov <= 150.0))
    refuse("camera.vertical_fov", "is not from 1 to 150");
  if (state.surfaces.empty()) refuse("surfaces", "is empty");
  if (static_cast<std::size_t>(state.active_surface) >= state.surfaces.size())
    refuse("active_surface", "is not the number of a surface");
  if (!(state.focus.radius > 0.0)) refuse("focus.radius", "is not above 0");
  if (state.curvature_tolerance && *state.curvature_tolerance < 0.0)
    refuse("curvature_tolerance", "is below 0");
  if (state.view_pixels && !(*state.view_pixels > 0.0)) refuse("view_pixels", "is not above 0");
  if (state.mesh_distance && !(*state.mesh_distance > 0.0))
    refuse("mesh_distance", "is not above 0");
  if (!(state.slice_views.zoom > 0.0)) refuse("slice_views.zoom", "is not above 0");
  if (state.pictures.times < 1 || state.pictures.times > kMostPictureTimes)
    refuse("pictures.times", "is not from 1 to " + std::to_string(kMostPictureTimes));
  for (const ViewSurface& surface : state.surfaces)
    if (bounded(surface.pieces) != surface.pieces)
      refuse("surfaces", "has one with pieces of an area below 0");
  for (const ViewMeasurement& measurement : state.measurements)
    if (measurement.points.size() != 2 && measurement.points.size() != 3)
      refuse("measurements", "has one that has neither 2 nor 3 points");
  if (state.clip_planes.size() > kMostClipPlanes) refuse("clip_planes", "has more than 6 elements");
  for (const HalfSpace& half_space : state.region.half_spaces)
    if (!(glm::length(half_space.normal) > 0.0))
      refuse("region.half_spaces", "has a normal of 0,0,0");
  for (const ViewBall& ball : state.region.balls)
    if (!(ball.radius > 0.0)) refuse("region.balls", "has one whose radius is not above 0");
}

// Takes out what views of earlier builds have, and no view has now.
void dropOldFields(OrderedJson& json) {
  if (!json.is_object()) return;
  for (const char* name : {"tolerance", "outlines"}) json.erase(name);
  const auto measurements = json.find("measurements");
  if (measurements == json.end() || !measurements->is_array()) return;
  // A distance over the surface has an isovalue. It goes: the straight one has another value.
  std::erase_if(measurements->get_ref<OrderedJson::array_t&>(), [](OrderedJson& measurement) {
    if (!measurement.is_object()) return false;
    const bool is_over = !measurement.value("surface_isovalue", OrderedJson()).is_null();
    measurement.erase("surface_isovalue");
    return is_over;
  });
}

// A path may be no UTF-8, but JSON is always UTF-8.
std::string textOf(const OrderedJson& json) {
  return json.dump(2, ' ', false, OrderedJson::error_handler_t::replace) + "\n";
}

OrderedJson parsed(const std::string& text) {
  if (nestingDepth(text) > kMostNesting) throw Error("the view is nested more than 16 deep");
  OrderedJson json = OrderedJson::parse(text, nullptr, false);
  if (json.is_discarded()) throw Error("the view is not JSON");
  return json;
}

ViewState stateFrom(OrderedJson json) {
  dropOldFields(json);
  ViewState state;
  state.camera.distance = 0.0;
  fromJson(json, "", state);
  checkRanges(state);
  return state;
}

// ------------------------------------------------------------------------------------------- files

bool isPathOfFile(const std::string& name) {
  return !name.empty() && !isRemotePath(name) && name.rfind("phantom:", 0) != 0;
}

std::filesystem::path folderOfView(const std::string& path) {
  return absolutePath(path).parent_path();
}

// As it stands in a view that lies in `folder`.
std::string writtenPath(const std::string& name, const std::filesystem::path& folder) {
  if (!isPathOfFile(name)) return name;
  const std::filesystem::path whole = absolutePath(name);
  const std::filesystem::path part = whole.lexically_relative(folder);
  return part.empty() || *part.begin() == ".." ? whole.string() : part.string();
}

std::string readPath(const std::string& name, const std::filesystem::path& folder) {
  return isPathOfFile(name) ? (folder / name).lexically_normal().string() : name;
}

// Of the state and of what it was saved of.
template <typename F>
void forEachPath(SavedView& view, F&& f) {
  f(view.volume);
  for (std::string& beside : view.beside) f(beside);
  f(view.state.values.other);
  for (ViewMask& mask : view.state.region.masks) f(mask.path);
}

// Takes the fields that are not the state's.
SavedView takeVolumes(OrderedJson& json) {
  SavedView view;
  if (!json.is_object()) return view;
  if (json.contains("version")) {
    const OrderedJson& version = json["version"];
    if (!version.is_number_integer()) throw Error("the view's 'version' is not a whole number");
    if (version > kViewVersion)
      throw Error("the view's 'version' is later than " + std::to_string(kViewVersion) +
                  "; a newer isobrick reads it");
    json.erase("version");
  }
  if (json.contains("beside")) fromJson(json["beside"], "beside", view.beside);
  json.erase("beside");
  if (view.beside.size() >= kMostVolumes)
    throw Error("the view has more than " + std::to_string(kMostVolumes) +
                " volumes: 'volume' and those 'beside' it");
  if (json.contains("volume")) {
    if (!json["volume"].is_string()) throw Error("the view's 'volume' is not a text");
    view.volume = json["volume"].get<std::string>();
    json.erase("volume");
  }
  if (view.volume.empty() && !view.beside.empty())
    throw Error("the view's 'volume' is missing, beside which others are");
  return view;
}

}  // namespace

std::string viewStateToJson(const ViewState& state) { return textOf(toJson(state)); }

ViewState viewStateFromJson(const std::string& text) { return stateFrom(parsed(text)); }

SavedView readView(const std::string& path) {
  const std::string text = readTextFile(path, "view");
  try {
    OrderedJson json = parsed(text);
    SavedView view = takeVolumes(json);
    view.state = stateFrom(std::move(json));
    const std::filesystem::path folder = folderOfView(path);
    forEachPath(view, [&](std::string& name) { name = readPath(name, folder); });
    return view;
  } catch (const Error& error) {
    throw Error("'" + path + "': " + error.what() + "; correct it or save the view anew", {path});
  }
}

void writeView(const std::string& path, const SavedView& view) {
  const std::filesystem::path folder = folderOfView(path);
  SavedView written = view;
  forEachPath(written, [&](std::string& name) { name = writtenPath(name, folder); });
  OrderedJson json = OrderedJson::object();
  json["version"] = kViewVersion;
  json["volume"] = written.volume;
  for (const std::string& beside : written.beside) json["beside"].push_back(beside);
  json.update(toJson(written.state));
  const std::string text = textOf(json);
  AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

std::string wholeName(const std::string& name) {
  return isPathOfFile(name) ? absolutePath(name).string() : name;
}

bool isSameVolume(const std::string& a, const std::string& b) {
  return wholeName(a) == wholeName(b);
}

}  // namespace isobrick
