#include <imgui.h>

#include <algorithm>
#include <array>

#include "isobrick/viewer/notes/draw_notes.h"
#include "isobrick/viewer/state/view_keys.h"
#include "isobrick/viewer/window/panel_tools.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {
namespace {

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

struct Place {
  ImVec2 corner;  // the upper left one, pixels of the window
  ImVec2 size;
  ImVec2 operator()(const glm::dvec2& pixel) const {
    return {corner.x + static_cast<float>(pixel.x), corner.y + static_cast<float>(pixel.y)};
  }
};

// Dark enough for light text, whatever is behind it: 7 : 1 on white (WCAG 2.2).
constexpr ImU32 kPlate = IM_COL32(0, 0, 0, 200);
void plate(ImDrawList& list, const ImVec2& upper_left, const ImVec2& lower_right, float scale) {
  const float margin = 4.0f * scale;
  list.AddRectFilled({upper_left.x - margin, upper_left.y - 1.0f * scale},
                     {lower_right.x + margin, lower_right.y + 1.0f * scale}, kPlate, 3.0f * scale);
}

// As long at the pivot as its text says, in world units.
void scaleBar(const ViewSession& session, float scale, const Place& place) {
  const ImVec2 size = place.size;
  if (size.y < 100.0f) return;
  const ViewCamera& camera = session.state().camera;
  const PlacedCamera placed = placeCamera(camera, 1.0);
  const double height = 2.0 * placed.half_height * (camera.orthographic ? 1.0 : camera.distance);
  const double per_pixel = height / static_cast<double>(size.y);
  const ScaleBar bar =
      scaleBarOf(per_pixel, static_cast<double>(std::min(150.0f * scale, 0.6f * size.x)));
  if (bar.length == 0.0) return;
  const auto pixels = static_cast<float>(bar.pixels);
  const ImVec2 end{place.corner.x + size.x - 24.0f * scale,
                   place.corner.y + size.y - 20.0f * scale};
  const std::string label = lengthText(bar.length, session.pyramid().spec().geometry.unit);
  const float wide = std::max(pixels, ImGui::CalcTextSize(label.c_str()).x);
  const ImVec2 begin{end.x - wide, end.y};
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  constexpr ImU32 kInk = IM_COL32(235, 235, 235, 255);
  plate(list, {begin.x, end.y - 20.0f * scale}, {end.x, end.y + 5.0f * scale}, scale);
  const Place in_window{{0.0f, 0.0f}, size};
  for (const NoteStroke& stroke : strokesOf(bar, {end.x, end.y}, 4.0 * static_cast<double>(scale)))
    list.AddLine(in_window(stroke.from), in_window(stroke.to), kInk, 2.0f * scale);
  list.AddText({begin.x, end.y - 20.0f * scale}, kInk, label.c_str());
}

// Sides of the world's axes; a click looks from there.
void axisCube(const ViewSession& session, bool hovers, const Place& place) {
  const Interaction& interaction = session.interaction();
  const std::vector<CubeFace> faces = cubeFacesOf(session.state().camera, interaction.picture());
  const auto hovered = hovers ? cubeFaceAt(faces, interaction.cursor) : std::nullopt;
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  for (const CubeFace& face : faces) {
    const int grey = static_cast<int>(100.0 + 100.0 * face.toward);
    const bool lit = hovered == face.view;
    const ImVec2 a = place(face.corners[0]), b = place(face.corners[1]), c = place(face.corners[2]),
                 d = place(face.corners[3]);
    list.AddQuadFilled(a, b, c, d,
                       lit ? IM_COL32(200, 180, 110, 230) : IM_COL32(grey, grey, grey, 230));
    list.AddQuad(a, b, c, d, IM_COL32(20, 22, 26, 255));
    if (face.toward < 0.3) continue;
    const char* const name = nameOf(face.view);
    const ImVec2 size = ImGui::CalcTextSize(name);
    // Black on 100 or more of 255 has a contrast of 4.5 : 1 (WCAG 2.2).
    list.AddText({0.5f * (a.x + c.x - size.x), 0.5f * (a.y + c.y - size.y)}, IM_COL32(0, 0, 0, 255),
                 name);
  }
}

void handles(const ViewSession& session, float scale, bool hovers, const Place& place) {
  const Interaction& interaction = session.interaction();
  if (interaction.flying) return;
  const std::vector<SceneHandle> all =
      handlesOf(session.state(), session.volume(), interaction.picture());
  const bool holds = interaction.drag == Interaction::Drag::kHandle;
  const auto under = hovers ? handleAt(all, interaction.cursor, interaction.scale) : std::nullopt;
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  constexpr std::array<ImU32, 3> kAxisColors{
      IM_COL32(230, 90, 80, 255), IM_COL32(110, 200, 90, 255), IM_COL32(90, 140, 240, 255)};
  for (const SceneHandle& handle : all) {
    const SceneHandle* const lit = holds ? &*interaction.held_handle : under ? &*under : nullptr;
    const bool is_lit = lit != nullptr && lit->kind == handle.kind && lit->number == handle.number;
    const bool of_focus = handle.kind == SceneHandle::Kind::kFocus;
    const ImU32 color = is_lit     ? IM_COL32(255, 237, 158, 255)
                        : of_focus ? kAxisColors[static_cast<std::size_t>(handle.number)]
                                   : IM_COL32(220, 220, 225, 255);
    const ImVec2 foot = place(handle.foot_pixel), tip = place(handle.tip);
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

// Those of the view, and the one that is being made.
void measurements(const ViewSession& session, float scale, const Place& place) {
  const Interaction& interaction = session.interaction();
  const PlacedCamera camera = placeCamera(session.state().camera, interaction.aspect());
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  constexpr ImU32 kInk = IM_COL32(255, 214, 102, 255);
  const auto draw = [&](const PictureMark& mark, const std::optional<glm::dvec2>& next) {
    std::vector<NoteStroke> strokes = strokesOf(mark.points, camera, interaction.size);
    if (strokes.empty()) return;
    const ImVec2 last = place(strokes.back().to);
    if (next) strokes.push_back({strokes.back().to, *next});
    for (const auto& [width, ink] : {std::pair{4.0f, kPlate}, std::pair{2.0f, kInk}})
      for (const NoteStroke& stroke : strokes)
        if (stroke.isDot())
          list.AddCircleFilled(place(stroke.from), (2.0f + width) * scale, ink);
        else
          list.AddLine(place(stroke.from), place(stroke.to), ink, width * scale);
    if (mark.text.empty()) return;
    const ImVec2 at{last.x + 8.0f * scale, last.y - 22.0f * scale};
    const ImVec2 size = ImGui::CalcTextSize(mark.text.c_str());
    plate(list, at, {at.x + size.x, at.y + size.y}, scale);
    list.AddText(at, kInk, mark.text.c_str());
  };
  const LengthUnit unit = session.pyramid().spec().geometry.unit;
  for (const PictureMark& mark : marksOf(session.state(), unit)) draw(mark, std::nullopt);
  if (interaction.tool != Interaction::Tool::kPiece)
    draw({interaction.picked, ""}, interaction.cursor);
}

void selectedPiece(const ViewSession& session, float scale, const Place& place) {
  const SurfaceComponent* const piece = session.pieces().selectedPiece();
  if (piece == nullptr) return;
  const Interaction& interaction = session.interaction();
  const PlacedCamera camera = placeCamera(session.state().camera, interaction.aspect());
  WorldBox box = emptyWorldBox();
  box.include(piece->lower);
  box.include(piece->upper);
  const std::array<glm::dvec3, 8> corners = cornersOf(box);
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  for (std::size_t from = 0; from < 8; ++from)
    for (const std::size_t axis : {1, 2, 4}) {
      if ((from & axis) != 0) continue;
      const PixelPath edge =
          pathOf(camera, interaction.size, {corners[from], corners[from | axis]});
      for (const auto& [a, b] : edge.lines)
        list.AddLine(place(a), place(b), IM_COL32(255, 214, 102, 255), 1.5f * scale);
    }
}

void help(ViewSession& session, float scale) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5f * size.x, 0.5f * size.y}, ImGuiCond_Appearing, {0.5f, 0.5f});
  if (ImGui::Begin("keys", &session.interaction().show_help,
                   ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoCollapse)) {
    // Narrow windows of a large scale have no room for the longest ones.
    const ImGuiStyle& style = ImGui::GetStyle();
    ImGui::PushTextWrapPos(size.x - 4.0f * style.WindowPadding.x - style.ScrollbarSize);
    for (const KeyHelp& line : keyHelp()) {
      ImGui::TextColored({1.0f, 0.93f, 0.62f, 1.0f}, "%s", line.keys);
      ImGui::SameLine(230.0f * scale);
      ImGui::TextUnformatted(line.what);
    }
    ImGui::PopTextWrapPos();
  }
  ImGui::End();
}

}  // namespace

void buildOverlay(ViewSession& session, float scale, bool hovers, const SceneArea& area) {
  const Place place{{static_cast<float>(area.left), 0.0f},
                    {static_cast<float>(area.width), static_cast<float>(area.height)}};
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  list.PushClipRect(place.corner, {place.corner.x + place.size.x, place.corner.y + place.size.y});
  scaleBar(session, scale, place);
  axisCube(session, hovers, place);
  selectedPiece(session, scale, place);
  measurements(session, scale, place);
  if (session.interaction().drag != Interaction::Drag::kPanel)
    handles(session, scale, hovers, place);
  list.PopClipRect();
  if (session.interaction().show_help) help(session, scale);
}

}  // namespace isobrick
