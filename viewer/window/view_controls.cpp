#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>

#include "isobrick/viewer/window/panel_tools.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {
namespace {

void histogram(ViewSession& session, float scale) {
  ViewState& state = session.state();
  const ValueHistogram& histogram = session.histogram();
  ViewSurface& active = state.surfaces[static_cast<std::size_t>(state.active_surface)];
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const ImVec2 size{ImGui::GetContentRegionAvail().x, 70.0f * scale};
  ImGui::InvisibleButton("histogram", size);
  const double span = std::max(histogram.greatest - histogram.least, 1e-30);
  if (ImGui::IsItemActive()) {
    const double share = std::clamp((ImGui::GetIO().MousePos.x - at.x) / size.x, 0.0f, 1.0f);
    active.isovalue = histogram.least + share * span;
  }
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(at, {at.x + size.x, at.y + size.y}, IM_COL32(20, 22, 26, 255));
  const double most = *std::max_element(histogram.counts.begin(), histogram.counts.end());
  const double highest = std::log1p(most);
  const float width = size.x / static_cast<float>(histogram.counts.size());
  for (std::size_t i = 0; i < histogram.counts.size(); ++i) {
    const auto height =
        static_cast<float>(std::log1p(histogram.counts[i]) / std::max(highest, 1e-30));
    const float x = at.x + width * static_cast<float>(i);
    list.AddRectFilled({x, at.y + size.y * (1.0f - height)}, {x + width, at.y + size.y},
                       IM_COL32(110, 130, 160, 255));
  }
  for (const ViewSurface& surface : state.surfaces) {
    const float x = at.x + size.x * static_cast<float>((surface.isovalue - histogram.least) / span);
    const bool is_active = &surface == &active;
    list.AddLine({x, at.y}, {x, at.y + size.y},
                 is_active ? IM_COL32(255, 237, 158, 255) : IM_COL32(200, 200, 200, 140),
                 is_active ? 2.0f : 1.0f);
  }
  for (const double suggested : session.volume().isovalues) {
    const float x = at.x + size.x * static_cast<float>((suggested - histogram.least) / span);
    const float half = 4.0f * scale;
    list.AddTriangleFilled({x - half, at.y}, {x + half, at.y}, {x, at.y + 1.6f * half},
                           IM_COL32(140, 220, 150, 255));
  }
  const double step = isovalueStep(session.volume());
  ImGui::InputDouble("isovalue", &active.isovalue, step, 10.0 * step, "%.6g");
  if (session.volume().isovalues.empty()) return;
  if (ImGui::SmallButton("next suggestion")) stepIsovalue(session.volume(), state);
  for (const double suggested : session.volume().isovalues) {
    ImGui::SameLine();
    ImGui::Text("%.6g", suggested);
  }
}

void surfaces(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("surfaces", ImGuiTreeNodeFlags_DefaultOpen)) return;
  ViewState& state = session.state();
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < state.surfaces.size(); ++i) {
    ViewSurface& surface = state.surfaces[i];
    ImGui::PushID(static_cast<int>(i));
    if (ImGui::RadioButton("##active", state.active_surface == static_cast<int>(i)))
      state.active_surface = static_cast<int>(i);
    ImGui::SameLine();
    ImGui::Checkbox("##visible", &surface.visible);
    ImGui::SameLine();
    ImGui::ColorEdit3("##color", &surface.color.r, ImGuiColorEditFlags_NoInputs);
    ImGui::SameLine();
    ImGui::SetNextItemWidth(90.0f * scale);
    sliderOf("##opacity", surface.opacity, 0.0, 1.0, "opacity %.2f");
    ImGui::SameLine();
    ImGui::Text("%.6g", surface.isovalue);
    if (state.surfaces.size() > 1) {
      ImGui::SameLine();
      if (ImGui::SmallButton("x")) removed = i;
    }
    ImGui::PopID();
  }
  constexpr std::size_t kMostSurfaces = 8;
  if (state.surfaces.size() < kMostSurfaces && ImGui::SmallButton("add surface")) {
    ViewSurface surface = state.surfaces[static_cast<std::size_t>(state.active_surface)];
    surface.color = {0.85f, 0.45f, 0.35f};
    state.surfaces.push_back(surface);
    state.active_surface = static_cast<int>(state.surfaces.size()) - 1;
  }
  if (removed) {
    state.surfaces.erase(state.surfaces.begin() + static_cast<std::ptrdiff_t>(*removed));
    state.active_surface =
        std::min(state.active_surface, static_cast<int>(state.surfaces.size()) - 1);
  }
}

void focus(ViewSession& session) {
  if (!ImGui::CollapsingHeader("region of interest", ImGuiTreeNodeFlags_DefaultOpen)) return;
  ViewState& state = session.state();
  const double most = session.volume().diagonal();
  ImGui::Checkbox("finest everywhere", &state.focus.everywhere);
  if (!state.focus.everywhere)
    sliderOf("radius", state.focus.radius, 4.0, most, "%.0f voxels", ImGuiSliderFlags_Logarithmic);
  const std::array<const char*, 3> names{"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis)
    sliderOf(names[static_cast<std::size_t>(axis)], state.focus.center[axis], 0.0,
             static_cast<double>(session.volume().voxels[axis] - 1), "%.0f");
  ImGui::Checkbox("sphere", &state.focus.show_sphere);
  ImGui::SameLine();
  ImGui::Checkbox("follow the view", &state.focus.follow_view);
}

// Parts that may stay coarse, by the oracles.
void detail(ViewSession& session) {
  if (!ImGui::CollapsingHeader("detail")) return;
  ViewState& state = session.state();
  const auto optional = [&](const char* label, std::optional<double>& value, double first) {
    bool on = value.has_value();
    if (ImGui::Checkbox(label, &on)) {
      value.reset();
      if (on) value = first;
    }
    return on;
  };
  if (optional("where cells are this small", state.view_pixels, 2.0))
    sliderOf("on the screen", *state.view_pixels, 0.5, 50.0, "%.1f pixels",
             ImGuiSliderFlags_Logarithmic);
  if (!session.pyramid().spec().has_curvature) return;
  if (!optional("where it is flat", state.curvature_tolerance, 0.005)) return;
  // As a radius: flatter than a sphere of so many voxels.
  double radius = std::sqrt(0.5 / std::max(*state.curvature_tolerance, 1e-12));
  if (sliderOf("flatter than", radius, 1.0, 100.0, "%.1f voxels", ImGuiSliderFlags_Logarithmic))
    state.curvature_tolerance = 0.5 / (radius * radius);
}

void clipPlanes(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("clip planes")) return;
  ViewState& state = session.state();
  const WorldBox box = session.volume().box();
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < state.clip_planes.size(); ++i) {
    ViewClipPlane& plane = state.clip_planes[i];
    ImGui::PushID(static_cast<int>(i));
    double least = 1e300, most = -1e300;
    for (const glm::dvec3& corner : cornersOf(box)) {
      least = std::min(least, glm::dot(corner, plane.normal));
      most = std::max(most, glm::dot(corner, plane.normal));
    }
    ImGui::Checkbox("##enabled", &plane.enabled);
    ImGui::SameLine();
    ImGui::SetNextItemWidth(80.0f * scale);
    sliderOf("##offset", plane.offset, least, most, "%.1f");
    ImGui::SameLine();
    ImGui::Checkbox("cap", &plane.cap);
    ImGui::SameLine();
    if (ImGui::SmallButton("flip plane")) {
      plane.normal = -plane.normal;
      plane.offset = -plane.offset;
    }
    ImGui::SameLine();
    if (ImGui::SmallButton("x")) removed = i;
    ImGui::SetNextItemWidth(200.0f * scale);
    std::array<float, 3> normal{static_cast<float>(plane.normal.x),
                                static_cast<float>(plane.normal.y),
                                static_cast<float>(plane.normal.z)};
    if (ImGui::DragFloat3("normal", normal.data(), 0.01f, -1.0f, 1.0f, "%.2f")) {
      const glm::dvec3 wanted(normal[0], normal[1], normal[2]);
      if (glm::length(wanted) > 1e-3) plane.normal = glm::normalize(wanted);
    }
    ImGui::PopID();
  }
  if (removed)
    state.clip_planes.erase(state.clip_planes.begin() + static_cast<std::ptrdiff_t>(*removed));
  if (state.clip_planes.size() == kMostClipPlanes) return;
  for (const char* axis : {"X", "Y", "Z"}) {
    if (ImGui::SmallButton(axis)) {
      ViewClipPlane plane;
      const int number = *axis - 'X';
      plane.normal = glm::dvec3(0.0);
      plane.normal[number] = 1.0;
      plane.offset = session.volume().geometry.indexToWorld(state.focus.center)[number];
      state.clip_planes.push_back(plane);
      break;
    }
    ImGui::SameLine();
  }
  ImGui::TextUnformatted("add plane");
}

void slices(ViewSession& session) {
  if (!ImGui::CollapsingHeader("slices")) return;
  ViewState& state = session.state();
  const std::array<const char*, 3> names{"across x", "across y", "across z"};
  for (int axis = 0; axis < 3; ++axis) {
    ViewSlice& slice = state.slices[static_cast<std::size_t>(axis)];
    ImGui::PushID(axis);
    ImGui::Checkbox("##shown", &slice.shown);
    ImGui::SameLine();
    sliderOf(names[static_cast<std::size_t>(axis)], slice.position, 0.0,
             static_cast<double>(session.volume().voxels[axis] - 1), "%.0f");
    ImGui::PopID();
  }
  const ValueHistogram& range = session.histogram();
  sliderOf("black", state.value_window[0], range.least, range.greatest, "%.5g");
  sliderOf("white", state.value_window[1], range.least, range.greatest, "%.5g");
}

// The colours of values, from the darkest to the lightest.
void valueBar(float scale) {
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const ImVec2 size{ImGui::GetContentRegionAvail().x, 10.0f * scale};
  ImGui::Dummy(size);
  // ImGui mixes sRGB values, the surfaces light: parts so small that it makes no difference.
  constexpr int kParts = 64;
  const auto colorAt = [](int part) {
    const glm::vec3 c = valueColor(static_cast<double>(part) / kParts);
    return ImGui::ColorConvertFloat4ToU32({c.r, c.g, c.b, 1.0f});
  };
  const float step = size.x / kParts;
  for (int i = 0; i < kParts; ++i) {
    const ImU32 low = colorAt(i), high = colorAt(i + 1);
    const float x = at.x + step * static_cast<float>(i);
    ImGui::GetWindowDrawList()->AddRectFilledMultiColor({x, at.y}, {x + step, at.y + size.y}, low,
                                                        high, high, low);
  }
}

// The meaning of the surfaces' colours.
void coloring(ViewSession& session, float scale) {
  ViewState& state = session.state();
  int chosen = static_cast<int>(state.coloring);
  if (ImGui::Combo("colour by", &chosen, "surface\0level\0gradient\0another pyramid\0"))
    state.coloring = static_cast<ViewColoring>(chosen);
  const bool by_other = state.coloring == ViewColoring::kOther;
  if (by_other) {
    std::array<char, 1024> path{};
    state.values.other.copy(path.data(), path.size() - 1);
    // Opened when it is typed, not at each letter.
    if (ImGui::InputText("pyramid", path.data(), path.size(), ImGuiInputTextFlags_EnterReturnsTrue))
      state.values.other = path.data();
  }
  const auto window = session.valueWindow();
  if (!window) return;
  valueBar(scale);
  const auto [least, greatest] = session.valueRange();
  std::array<double, 2> wanted = *window;
  const ImGuiSliderFlags flags = by_other ? 0 : ImGuiSliderFlags_Logarithmic;
  const bool dark = sliderOf("darkest", wanted[0], least, greatest, "%.4g", flags);
  const bool light = sliderOf("lightest", wanted[1], least, greatest, "%.4g", flags);
  if (dark || light) (by_other ? state.values.other_window : state.values.gradient_window) = wanted;
}

void look(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("appearance")) return;
  ViewState& state = session.state();
  coloring(session, scale);
  ImGui::Checkbox("transitions", &state.show_transitions);
  ImGui::SameLine();
  ImGui::Checkbox("wireframe", &state.wireframe);
  bool headlight = state.lighting == ViewLighting::kHeadlight;
  if (ImGui::Checkbox("headlight", &headlight))
    state.lighting = headlight ? ViewLighting::kHeadlight : ViewLighting::kThreeLights;
  ImGui::SameLine();
  ImGui::Checkbox("ambient occlusion", &state.ambient_occlusion);
  ImGui::Checkbox("box", &state.show_box);
  ImGui::SameLine();
  ImGui::Checkbox("arrows", &state.show_handles);
  ImGui::Checkbox("orthographic", &state.camera.orthographic);
  sliderOf("field of view", state.camera.vertical_fov, 10.0, 90.0, "%.0f degrees");
  ImGui::ColorEdit3("above", &state.background_top.r, ImGuiColorEditFlags_NoInputs);
  ImGui::SameLine();
  ImGui::ColorEdit3("below", &state.background_bottom.r, ImGuiColorEditFlags_NoInputs);
}

void meshDistance(std::optional<double>& distance, float scale) {
  constexpr double kFirst = 0.5;  // voxels
  bool simplified = distance.has_value();
  if (ImGui::Checkbox("simplify meshes", &simplified))
    distance = simplified ? std::optional(kFirst) : std::nullopt;
  if (!distance) return;
  ImGui::SameLine();
  ImGui::SetNextItemWidth(110.0f * scale);
  sliderOf("##within", *distance, 0.05, 10.0, "within %.2f voxels", ImGuiSliderFlags_Logarithmic);
}

Wishes files(ViewState& state, float scale) {
  Wishes wishes;
  if (!ImGui::CollapsingHeader("files")) return wishes;
  wishes.browse = ImGui::SmallButton("open");
  ImGui::SameLine();
  wishes.screenshot = ImGui::SmallButton("picture");
  ImGui::SameLine();
  wishes.screenshot_exr = ImGui::SmallButton("EXR");
  ImGui::SameLine();
  wishes.export_mesh = ImGui::SmallButton("mesh");
  wishes.save_state = ImGui::SmallButton("save view");
  ImGui::SameLine();
  wishes.load_state = ImGui::SmallButton("load view");
  ImGui::Checkbox("transparent", &state.pictures.transparent);
  ImGui::SameLine();
  ImGui::SetNextItemWidth(80.0f * scale);
  ImGui::SliderInt("x window", &state.pictures.times, 1, kMostPictureTimes);
  meshDistance(state.mesh_distance, scale);
  return wishes;
}

}  // namespace

Wishes buildControls(ViewSession& session, float scale) {
  histogram(session, scale);
  surfaces(session, scale);
  focus(session);
  detail(session);
  clipPlanes(session, scale);
  slices(session);
  look(session, scale);
  return files(session.state(), scale);
}

}  // namespace isobrick
