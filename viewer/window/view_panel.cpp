#include "isobrick/viewer/window/view_panel.h"

#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstdio>
#include <glm/geometric.hpp>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

constexpr float kPanelWidth = 300.0f;
constexpr float kStatusHeight = 26.0f;

int indexOf(Key key) { return static_cast<int>(key); }

template <typename... Arguments>
std::string text(const char* format, Arguments... arguments) {
  std::array<char, 256> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, arguments...);
  return buffer.data();
}

bool sliderOf(const char* label, double& value, double least, double greatest, const char* format,
              ImGuiSliderFlags flags = 0) {
  return ImGui::SliderScalar(label, ImGuiDataType_Double, &value, &least, &greatest, format, flags);
}

std::string megabytes(std::uint64_t bytes) {
  return text("%.1f MiB", static_cast<double>(bytes) / (1 << 20));
}

const char* nameOf(AxisView view) {
  switch (view) {
    case AxisView::kFront:
      return "-y";
    case AxisView::kBack:
      return "+y";
    case AxisView::kRight:
      return "+x";
    case AxisView::kLeft:
      return "-x";
    case AxisView::kTop:
      return "+z";
    case AxisView::kBottom:
      return "-z";
  }
  return "";
}

// 1, 2 or 5 times a power of ten, at most `most`.
double roundLength(double most) {
  const double power = std::pow(10.0, std::floor(std::log10(most)));
  for (const double step : {5.0, 2.0})
    if (step * power <= most) return step * power;
  return power;
}

}  // namespace

ViewPanel::ViewPanel(double scale) : scale_(scale) {
  ImGui::CreateContext();
  ImGuiIO& io = ImGui::GetIO();
  io.IniFilename = nullptr;  // nothing is left in the user's folder
  io.FontGlobalScale = static_cast<float>(scale);
  ImGui::StyleColorsDark();
  ImGui::GetStyle().ScaleAllSizes(static_cast<float>(scale));
  ImGui::GetStyle().WindowRounding = 0.0f;
  io.KeyMap[ImGuiKey_Tab] = indexOf(Key::kTab);
  io.KeyMap[ImGuiKey_LeftArrow] = indexOf(Key::kLeft);
  io.KeyMap[ImGuiKey_RightArrow] = indexOf(Key::kRight);
  io.KeyMap[ImGuiKey_UpArrow] = indexOf(Key::kUp);
  io.KeyMap[ImGuiKey_DownArrow] = indexOf(Key::kDown);
  io.KeyMap[ImGuiKey_Home] = indexOf(Key::kHome);
  io.KeyMap[ImGuiKey_End] = indexOf(Key::kEnd);
  io.KeyMap[ImGuiKey_Delete] = indexOf(Key::kDelete);
  io.KeyMap[ImGuiKey_Backspace] = indexOf(Key::kBackspace);
  io.KeyMap[ImGuiKey_Enter] = indexOf(Key::kEnter);
  io.KeyMap[ImGuiKey_Escape] = indexOf(Key::kEscape);
  io.KeyMap[ImGuiKey_A] = indexOf(Key::kA);
  io.KeyMap[ImGuiKey_C] = indexOf(Key::kC);
  io.KeyMap[ImGuiKey_V] = indexOf(Key::kV);
  io.KeyMap[ImGuiKey_X] = indexOf(Key::kX);
  io.KeyMap[ImGuiKey_Y] = indexOf(Key::kY);
  io.KeyMap[ImGuiKey_Z] = indexOf(Key::kZ);
  if (!ImGui_ImplOpenGL3_Init("#version 450")) {
    ImGui::DestroyContext();
    throw Error(
        "cannot draw the panel: libGL.so.1 cannot be used; install it (Debian and Ubuntu: apt "
        "install libgl1), or draw pictures with 'isobrick render'");
  }
}

ViewPanel::~ViewPanel() {
  ImGui_ImplOpenGL3_Shutdown();
  ImGui::DestroyContext();
}

void ViewPanel::feed(const InputEvent& event) {
  ImGuiIO& io = ImGui::GetIO();
  io.KeyShift = event.shift;
  io.KeyCtrl = event.control;
  const auto button = [&] {
    return event.button == MouseButton::kLeft ? 0 : event.button == MouseButton::kRight ? 1 : 2;
  };
  switch (event.kind) {
    case InputEvent::Kind::kMove:
      io.MousePos = {static_cast<float>(event.x), static_cast<float>(event.y)};
      break;
    case InputEvent::Kind::kPress:
      io.MouseDown[button()] = true;
      break;
    case InputEvent::Kind::kRelease:
      io.MouseDown[button()] = false;
      break;
    case InputEvent::Kind::kWheel:
      io.MouseWheel += static_cast<float>(event.amount);
      break;
    case InputEvent::Kind::kKeyPress:
      io.KeysDown[indexOf(event.key)] = true;
      break;
    case InputEvent::Kind::kKeyRelease:
      io.KeysDown[indexOf(event.key)] = false;
      break;
    case InputEvent::Kind::kText:
      io.AddInputCharacter(event.character);
      break;
    case InputEvent::Kind::kResize:
    case InputEvent::Kind::kClose:
    case InputEvent::Kind::kOpen:
      break;
  }
}

void ViewPanel::begin(int width, int height, double seconds) {
  ImGuiIO& io = ImGui::GetIO();
  io.DisplaySize = {static_cast<float>(width), static_cast<float>(height)};
  io.DeltaTime = static_cast<float>(std::clamp(seconds, 1e-4, 1.0));
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::NewFrame();
}

bool ViewPanel::wantsMouse() const { return ImGui::GetIO().WantCaptureMouse; }
bool ViewPanel::wantsKeyboard() const { return ImGui::GetIO().WantTextInput; }

void ViewPanel::draw() {
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

void ViewPanel::discard() { ImGui::EndFrame(); }

Wishes ViewPanel::all(ViewSession& session, const PanelFacts& facts) {
  ImGui::PushItemWidth(static_cast<float>(scale_) * kPanelWidth * 0.52f);
  histogram(session);
  surfaces(session);
  focus(session);
  detail(session);
  clipPlanes(session);
  slices(session);
  look(session);
  const Wishes wishes = files(session.state().pictures);
  statistics(session, facts);
  ImGui::PopItemWidth();
  return wishes;
}

Wishes ViewPanel::build(ViewSession* session, const PanelFacts& facts) {
  Wishes wishes;
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const auto scaled = [&](float length) { return length * static_cast<float>(scale_); };
  const ImGuiWindowFlags fixed = ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize |
                                 ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoTitleBar |
                                 ImGuiWindowFlags_NoNav;
  if (session != nullptr && session->interaction().show_panel) {
    ImGui::SetNextWindowPos({0.0f, 0.0f});
    ImGui::SetNextWindowSize({scaled(kPanelWidth), std::max(1.0f, size.y - scaled(kStatusHeight))});
    ImGui::SetNextWindowBgAlpha(0.82f);
    if (ImGui::Begin("panel", nullptr, fixed | ImGuiWindowFlags_NoBringToFrontOnFocus))
      wishes = all(*session, facts);
    ImGui::End();
  }
  ImGui::SetNextWindowPos({0.0f, size.y - scaled(kStatusHeight)});
  ImGui::SetNextWindowSize({std::max(1.0f, size.x), scaled(kStatusHeight)});
  ImGui::SetNextWindowBgAlpha(0.82f);
  if (ImGui::Begin("status", nullptr, fixed | ImGuiWindowFlags_NoScrollbar))
    addWishes(statusLine(session, facts), wishes);
  ImGui::End();
  addWishes(openingError(facts), wishes);
  addWishes(open_panel_.build(scale_, facts.recent), wishes);
  if (session == nullptr) return wishes;
  scaleBar(*session);
  axisCube(*session);
  if (session->interaction().drag != Interaction::Drag::kPanel) handles(*session);
  if (session->interaction().show_help) help(*session);
  return wishes;
}

void ViewPanel::histogram(ViewSession& session) {
  ViewState& state = session.state();
  const ValueHistogram& histogram = session.histogram();
  ViewSurface& active = state.surfaces[static_cast<std::size_t>(state.active_surface)];
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const ImVec2 size{ImGui::GetContentRegionAvail().x, 70.0f * static_cast<float>(scale_)};
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
  ImGui::InputDouble("isovalue", &active.isovalue, 1.0, 10.0, "%.6g");
}

void ViewPanel::surfaces(ViewSession& session) {
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
    ImGui::SetNextItemWidth(90.0f * static_cast<float>(scale_));
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
  if (state.surfaces.size() < kMostSurfaces && ImGui::SmallButton("another surface")) {
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

void ViewPanel::focus(ViewSession& session) {
  if (!ImGui::CollapsingHeader("focus", ImGuiTreeNodeFlags_DefaultOpen)) return;
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

// In units of the data, over multiples of the noise where that is known.
void ViewPanel::tolerance(double& value, double sigma, double span) {
  if (!(sigma > 0.0)) {
    sliderOf("of the data", value, 0.0, 0.2 * span, "%.4g", ImGuiSliderFlags_Logarithmic);
    return;
  }
  constexpr int kMostSigmas = 6;
  sliderOf("of the data", value, 0.0, kMostSigmas * sigma, "%.4g");
  // The grab's middle goes from half its width to half its width before the end.
  const ImVec2 lower = ImGui::GetItemRectMin(), upper = ImGui::GetItemRectMax();
  const float rim = 2.0f + 0.5f * ImGui::GetStyle().GrabMinSize;
  for (int i = 1; i < kMostSigmas; ++i) {
    const float share = static_cast<float>(i) / kMostSigmas;
    const float x = lower.x + rim + share * (upper.x - lower.x - 2.0f * rim);
    ImGui::GetWindowDrawList()->AddLine({x, upper.y - 5.0f * static_cast<float>(scale_)},
                                        {x, upper.y}, IM_COL32(255, 237, 158, 255));
  }
  ImGui::Text("%.2f sigma; a mark each, sigma is %.4g", value / sigma, sigma);
}

// What may stay coarse, by the oracles.
void ViewPanel::detail(ViewSession& session) {
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
  const double span = session.histogram().greatest - session.histogram().least;
  const double sigma = session.pyramid().noise();
  if (optional("where the value is off by at most", state.tolerance,
               sigma > 0.0 ? sigma : 0.01 * span))
    tolerance(*state.tolerance, sigma, span);
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

void ViewPanel::clipPlanes(ViewSession& session) {
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
    ImGui::SetNextItemWidth(110.0f * static_cast<float>(scale_));
    sliderOf("##offset", plane.offset, least, most, "%.1f");
    ImGui::SameLine();
    ImGui::Checkbox("cap", &plane.cap);
    ImGui::SameLine();
    if (ImGui::SmallButton("turn")) {
      plane.normal = -plane.normal;
      plane.offset = -plane.offset;
    }
    ImGui::SameLine();
    if (ImGui::SmallButton("x")) removed = i;
    ImGui::SetNextItemWidth(200.0f * static_cast<float>(scale_));
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
  ImGui::TextUnformatted("another one");
}

void ViewPanel::slices(ViewSession& session) {
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

void ViewPanel::look(ViewSession& session) {
  if (!ImGui::CollapsingHeader("look")) return;
  ViewState& state = session.state();
  bool by_level = state.coloring == ViewColoring::kLevel;
  if (ImGui::Checkbox("colour by level", &by_level))
    state.coloring = by_level ? ViewColoring::kLevel : ViewColoring::kPlain;
  ImGui::SameLine();
  ImGui::Checkbox("wireframe", &state.wireframe);
  bool headlight = state.lighting == ViewLighting::kHeadlight;
  if (ImGui::Checkbox("headlight", &headlight))
    state.lighting = headlight ? ViewLighting::kHeadlight : ViewLighting::kThreeLights;
  ImGui::SameLine();
  ImGui::Checkbox("box", &state.show_box);
  ImGui::SameLine();
  ImGui::Checkbox("arrows", &state.show_handles);
  ImGui::Checkbox("orthographic", &state.camera.orthographic);
  sliderOf("field of view", state.camera.vertical_fov, 10.0, 90.0, "%.0f degrees");
  ImGui::ColorEdit3("above", &state.background_top.r, ImGuiColorEditFlags_NoInputs);
  ImGui::SameLine();
  ImGui::ColorEdit3("below", &state.background_bottom.r, ImGuiColorEditFlags_NoInputs);
}

Wishes ViewPanel::files(ViewPictures& pictures) {
  Wishes wishes;
  if (!ImGui::CollapsingHeader("files")) return wishes;
  wishes.browse = ImGui::SmallButton("open");
  ImGui::SameLine();
  wishes.screenshot = ImGui::SmallButton("picture");
  ImGui::SameLine();
  wishes.screenshot_exr = ImGui::SmallButton("EXR");
  ImGui::SameLine();
  wishes.export_mesh = ImGui::SmallButton("mesh");
  ImGui::SameLine();
  wishes.save_state = ImGui::SmallButton("save view");
  ImGui::SameLine();
  wishes.load_state = ImGui::SmallButton("load view");
  ImGui::Checkbox("transparent", &pictures.transparent);
  ImGui::SameLine();
  ImGui::SliderInt("x window", &pictures.times, 1, 8);
  return wishes;
}

void ViewPanel::statistics(const ViewSession& session, const PanelFacts& facts) {
  if (!ImGui::CollapsingHeader("what is going on", ImGuiTreeNodeFlags_DefaultOpen)) return;
  const SessionStatus status = session.status();
  ImGui::Text("%llu triangles, %s", static_cast<unsigned long long>(status.triangles),
              megabytes(status.shown_bytes).c_str());
  ImGui::Text("radius %.0f of %.0f voxels", status.shown_radius, status.wanted_radius);
  ImGui::Text("extracted in %.1f ms, %.1f Mtri/s", 1e3 * status.extract_seconds,
              1e-6 * status.triangles_per_second);
  ImGui::Text("radius while dragging %.0f", status.drag_radius);
  ImGui::Text("bricks read by the pass: %llu", static_cast<unsigned long long>(status.bricks_read));
  ImGui::Text("in memory %s of %s", megabytes(session.pyramid().heldBytes()).c_str(),
              megabytes(session.pyramid().budgetBytes()).c_str());
  const BrickPager::Counters counters = session.pyramid().counters();
  ImGui::Text("parts read %llu, evicted %llu", static_cast<unsigned long long>(counters.parts_read),
              static_cast<unsigned long long>(counters.parts_released));
  for (const LevelCounts& level : status.levels) {
    const double share =
        static_cast<double>(level.triangles) / std::max(1.0, static_cast<double>(status.triangles));
    ImGui::ProgressBar(
        static_cast<float>(share), {-1.0f, 0.0f},
        text("level %d: %llu", level.level, static_cast<unsigned long long>(level.triangles))
            .c_str());
  }
  std::array<float, 240> interface {
  }, drawing{};
  const std::size_t count = std::min(facts.frames.size(), interface.size());
  for (std::size_t i = 0; i < count; ++i) {
    const FrameTimes& frame = facts.frames[facts.frames.size() - count + i];
    interface[i] = static_cast<float>(1e3 * frame.interface);
    drawing[i] = static_cast<float>(1e3 * frame.draw);
  }
  const auto plot = [&](const char* label, const std::array<float, 240>& values) {
    const float last = count > 0 ? values[count - 1] : 0.0f;
    ImGui::PlotLines("##times", values.data(), static_cast<int>(count), 0,
                     text("%s %.1f ms", label, static_cast<double>(last)).c_str(), 0.0f, FLT_MAX,
                     {-1.0f, 36.0f * static_cast<float>(scale_)});
  };
  plot("interface", interface);
  plot("drawing", drawing);
  ImGui::TextWrapped("%s", facts.device.c_str());
}

Wishes ViewPanel::statusLine(ViewSession* session, const PanelFacts& facts) {
  const Wishes wishes = openingLine(facts);
  if (session != nullptr) {
    if (facts.opening.busy) {
      ImGui::TextUnformatted("|");
      ImGui::SameLine();
    }
    sessionLine(*session, facts);
  } else if (!facts.opening.busy) {
    ImGui::TextUnformatted("N: open a volume, or drop one here");
  }
  return wishes;
}

// What is being opened, or why the last one was not; the session's line goes on beside it.
Wishes ViewPanel::openingLine(const PanelFacts& facts) {
  Wishes wishes;
  const VolumeOpener::Status& opening = facts.opening;
  if (opening.busy) {
    wishes.stop_opening = ImGui::SmallButton("stop");
    ImGui::SameLine();
    const std::size_t slash = opening.source.find_last_of('/');
    const std::string name = shownName(
        slash + 1 < opening.source.size() ? opening.source.substr(slash + 1) : opening.source);
    if (opening.phase.empty())
      ImGui::Text("opening %s", name.c_str());
    else
      ImGui::Text("building %s: %s %.0f %%", name.c_str(), shownName(opening.phase).c_str(),
                  100.0 * opening.share);
    ImGui::SameLine();
  }
  return wishes;
}

// Above the line at the foot, as long as it is: why the last opening ended without a volume.
Wishes ViewPanel::openingError(const PanelFacts& facts) {
  Wishes wishes;
  if (facts.open_error.empty()) return wishes;
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float width = std::max(1.0f, size.x);
  ImGui::SetNextWindowPos({0.0f, size.y - kStatusHeight * static_cast<float>(scale_)},
                          ImGuiCond_Always, {0.0f, 1.0f});
  ImGui::SetNextWindowSizeConstraints({width, 0.0f}, {width, std::max(1.0f, size.y)});
  if (ImGui::Begin("why not", nullptr,
                   ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                       ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoNav)) {
    wishes.stop_opening = ImGui::SmallButton("x");
    ImGui::SameLine();
    ImGui::PushStyleColor(ImGuiCol_Text, {1.0f, 0.5f, 0.4f, 1.0f});
    ImGui::TextWrapped("%s", shownName(facts.open_error).c_str());
    ImGui::PopStyleColor();
  }
  ImGui::End();
  return wishes;
}

void ViewPanel::sessionLine(ViewSession& session, const PanelFacts& facts) {
  const SessionStatus status = session.status();
  if (!status.error.empty()) {
    ImGui::TextColored({1.0f, 0.5f, 0.4f, 1.0f}, "%s", status.error.c_str());
  } else {
    ImGui::TextUnformatted(status.doing.c_str());
    if (!status.limited.empty()) {
      ImGui::SameLine();
      ImGui::TextColored({1.0f, 0.85f, 0.5f, 1.0f}, "| %s", status.limited.c_str());
    }
    if (!facts.message.empty()) {
      ImGui::SameLine();
      ImGui::Text("| %s", facts.message.c_str());
    }
  }
  // Reading depth waits for the drawing, so only a hand that rests asks for it.
  if (session.settled() && !wantsMouse()) {
    hover_.clear();
    if (const auto point = session.surfaceAt(session.interaction().cursor)) {
      const glm::dvec3 voxel = session.volume().geometry.worldToIndex(*point);
      hover_ = text("voxel %.1f %.1f %.1f   world %.1f %.1f %.1f", voxel.x, voxel.y, voxel.z,
                    point->x, point->y, point->z);
    }
  }
  const std::string right = hover_.empty() ? "H: keys" : hover_;
  ImGui::SameLine(std::max(ImGui::GetCursorPosX(), ImGui::GetIO().DisplaySize.x -
                                                       ImGui::CalcTextSize(right.c_str()).x -
                                                       12.0f * static_cast<float>(scale_)));
  ImGui::TextUnformatted(right.c_str());
}

// As long at the pivot as its text says, in world units.
void ViewPanel::scaleBar(const ViewSession& session) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  if (size.y < 100.0f) return;
  const ViewCamera& camera = session.state().camera;
  const PlacedCamera placed = placeCamera(camera, 1.0);
  const double height = 2.0 * placed.half_height * (camera.orthographic ? 1.0 : camera.distance);
  const double per_pixel = height / static_cast<double>(size.y);
  const double length = roundLength(150.0 * scale_ * per_pixel);
  const auto pixels = static_cast<float>(length / per_pixel);
  const auto scale = static_cast<float>(scale_);
  const ImVec2 end{size.x - 24.0f * scale, size.y - (kStatusHeight + 20.0f) * scale};
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  const ImU32 white = IM_COL32(235, 235, 235, 220);
  list.AddLine({end.x - pixels, end.y}, end, white, 2.0f * scale);
  for (const float x : {end.x - pixels, end.x})
    list.AddLine({x, end.y - 4.0f * scale}, {x, end.y + 4.0f * scale}, white, 2.0f * scale);
  list.AddText({end.x - pixels, end.y - 20.0f * scale}, white, text("%g", length).c_str());
}

// Sides of the world's axes; a click looks from there.
void ViewPanel::axisCube(const ViewSession& session) {
  const Interaction& interaction = session.interaction();
  const std::vector<CubeFace> faces = cubeFacesOf(session.state().camera, interaction.picture());
  const auto hovered = wantsMouse() ? std::nullopt : cubeFaceAt(faces, interaction.cursor);
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  const auto place = [](const glm::dvec2& p) {
    return ImVec2(static_cast<float>(p.x), static_cast<float>(p.y));
  };
  for (const CubeFace& face : faces) {
    const int grey = static_cast<int>(70.0 + 90.0 * face.toward);
    const bool lit = hovered == face.view;
    const ImVec2 a = place(face.corners[0]), b = place(face.corners[1]), c = place(face.corners[2]),
                 d = place(face.corners[3]);
    list.AddQuadFilled(a, b, c, d,
                       lit ? IM_COL32(200, 180, 110, 230) : IM_COL32(grey, grey, grey, 230));
    list.AddQuad(a, b, c, d, IM_COL32(20, 22, 26, 255));
    if (face.toward < 0.3) continue;
    const char* const name = nameOf(face.view);
    const ImVec2 size = ImGui::CalcTextSize(name);
    list.AddText({0.5f * (a.x + c.x - size.x), 0.5f * (a.y + c.y - size.y)},
                 IM_COL32(255, 255, 255, 255), name);
  }
}

void ViewPanel::handles(const ViewSession& session) {
  const Interaction& interaction = session.interaction();
  if (interaction.flying) return;
  const std::vector<SceneHandle> all =
      handlesOf(session.state(), session.volume(), interaction.picture());
  const bool holds = interaction.drag == Interaction::Drag::kHandle;
  const auto under =
      wantsMouse() ? std::nullopt : handleAt(all, interaction.cursor, interaction.scale);
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  const auto scale = static_cast<float>(scale_);
  constexpr std::array<ImU32, 3> kAxisColors{
      IM_COL32(230, 90, 80, 255), IM_COL32(110, 200, 90, 255), IM_COL32(90, 140, 240, 255)};
  for (const SceneHandle& handle : all) {
    const SceneHandle* const lit = holds ? &*interaction.held_handle : under ? &*under : nullptr;
    const bool is_lit = lit != nullptr && lit->kind == handle.kind && lit->number == handle.number;
    const bool of_focus = handle.kind == SceneHandle::Kind::kFocus;
    const ImU32 color = is_lit     ? IM_COL32(255, 237, 158, 255)
                        : of_focus ? kAxisColors[static_cast<std::size_t>(handle.number)]
                                   : IM_COL32(220, 220, 225, 255);
    const ImVec2 foot(static_cast<float>(handle.foot_pixel.x),
                      static_cast<float>(handle.foot_pixel.y));
    const ImVec2 tip(static_cast<float>(handle.tip.x), static_cast<float>(handle.tip.y));
    list.AddLine(foot, tip, IM_COL32(0, 0, 0, 160), 4.0f * scale);
    list.AddLine(foot, tip, color, 2.0f * scale);
    if (of_focus) {
      list.AddCircleFilled(tip, 5.0f * scale, color);
    } else {
      const float half = 5.0f * scale;
      list.AddRectFilled({tip.x - half, tip.y - half}, {tip.x + half, tip.y + half}, color);
    }
  }
}

void ViewPanel::help(ViewSession& session) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5f * size.x, 0.5f * size.y}, ImGuiCond_Appearing, {0.5f, 0.5f});
  if (ImGui::Begin("keys", &session.interaction().show_help,
                   ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoCollapse)) {
    for (const KeyHelp& line : kKeyHelp) {
      ImGui::TextColored({1.0f, 0.93f, 0.62f, 1.0f}, "%s", line.keys);
      ImGui::SameLine(230.0f * static_cast<float>(scale_));
      ImGui::TextUnformatted(line.what);
    }
  }
  ImGui::End();
}

}  // namespace isobrick
