#include <imgui.h>

#include <array>
#include <cmath>
#include <cstdint>

#include "isobrick/viewer/state/measurement.h"
#include "isobrick/viewer/stream/plane_sampler.h"
#include "isobrick/viewer/window/panel_tools.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {

void PanelTexture::set(const PictureBytes& picture) {
  if (*texture_ == 0) texture_ = GlTexture::make(GL_TEXTURE_2D);
  glBindTexture(GL_TEXTURE_2D, *texture_);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  if (picture.width == width_ && picture.height == height_) {
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width_, height_, GL_RGBA, GL_UNSIGNED_BYTE,
                    picture.rgba.data());
  } else {
    width_ = picture.width;
    height_ = picture.height;
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, width_, height_, 0, GL_RGBA, GL_UNSIGNED_BYTE,
                 picture.rgba.data());
    for (const GLenum side : {GL_TEXTURE_WRAP_S, GL_TEXTURE_WRAP_T})
      glTexParameteri(GL_TEXTURE_2D, side, GL_CLAMP_TO_EDGE);
    for (const GLenum filter : {GL_TEXTURE_MIN_FILTER, GL_TEXTURE_MAG_FILTER})
      glTexParameteri(GL_TEXTURE_2D, filter, GL_LINEAR);
  }
  glBindTexture(GL_TEXTURE_2D, 0);
}

ImTextureID PanelTexture::id() const {
  // ImGui's OpenGL renderer takes the number of a texture for its address.
  return reinterpret_cast<ImTextureID>(static_cast<std::intptr_t>(*texture_));
}

namespace {

// The colours of the slices' lines in the other views, and of their names: across x, y and z.
constexpr std::array<ImU32, 3> kSliceColors{
    IM_COL32(240, 120, 110, 255), IM_COL32(140, 215, 120, 255), IM_COL32(130, 170, 255, 255)};
constexpr std::array<const char*, 3> kAxisNames{"x", "y", "z"};

std::vector<SliceContour> contoursOf(const ViewState& state) {
  std::vector<SliceContour> contours;
  for (const ViewSurface& surface : state.surfaces)
    if (surface.volume == 0 && surface.visible && surface.opacity > 0.0)
      contours.push_back({surface.isovalue, surface.color});
  return contours;
}

void shadowed(ImDrawList& list, const ImVec2& at, ImU32 color, const std::string& text) {
  list.AddText({at.x + 1.0f, at.y + 1.0f}, IM_COL32(0, 0, 0, 255), text.c_str());
  list.AddText(at, color, text.c_str());
}

}  // namespace

// Made anew if the values, the window or the contours are others.
const PanelTexture& SlicesPanel::pictureOf(int view, const SliceViews::Shown& shown,
                                           const ViewState& state, float scale) {
  Picture& picture = pictures_[static_cast<std::size_t>(view)];
  const Look look{shown.number, state.value_window, contoursOf(state)};
  // One in a frame while something is dragged: the others follow in the next ones.
  const bool waits = ImGui::IsAnyMouseDown() && has_drawn_;
  if (picture.texture.isEmpty() || (picture.look != look && !waits)) {
    has_drawn_ = true;
    constexpr double kWidth = 1.5;  // of contours, pixels of an ordinary screen
    picture.texture.set(drawSlice(shown.values, look.window, look.contours,
                                  kWidth * static_cast<double>(scale) / shown.pixels));
    picture.look = look;
  }
  return picture.texture;
}

// Events of the mouse on a view, whose upper left corner is at `corner`.
void SlicesPanel::input(ViewSession& session, const SliceFrame& frame, const ImVec2& corner) {
  ViewState& state = session.state();
  const ImGuiIO& io = ImGui::GetIO();
  const auto here = [&](const ImVec2& mouse) {
    return glm::dvec2(static_cast<double>(mouse.x - corner.x),
                      static_cast<double>(mouse.y - corner.y));
  };
  const glm::dvec2 now = here(io.MousePos);
  const glm::dvec2 before =
      here({io.MousePos.x - io.MouseDelta.x, io.MousePos.y - io.MouseDelta.y});
  const bool moves = now != before;
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f) {
    const auto notches = static_cast<double>(io.MouseWheel);
    constexpr double kPerNotch = 1.15;
    if (io.KeyCtrl)
      zoomSlices(frame, now, std::pow(kPerNotch, notches), state);
    else
      stepSlice(frame, notches, state);
  }
  if (!ImGui::IsItemActive()) return;
  if (ImGui::IsMouseDown(0) && !io.KeyShift) {
    if (ImGui::IsMouseDoubleClicked(0)) {
      glm::dvec3 place = frame.indexAt(now);
      place[frame.axis] = state.slices[static_cast<std::size_t>(frame.axis)].position;
      focusOn(session.volume().geometry.indexToWorld(place), session.volume(), state);
    }
    crossAt(frame, frame.indexAt(now), state);
  } else if ((ImGui::IsMouseDown(2) || ImGui::IsMouseDown(0)) && moves) {
    moveSlices(frame, before, now, state);
  } else if (ImGui::IsMouseDown(1) && moves) {
    dragWindow(now - before, session.volume(), state);
  }
}

// Lines of the other two slices, names, the value under the cursor.
void SlicesPanel::notes(const ViewSession& session, const SliceFrame& frame,
                        const SliceViews::Shown* shown, const ImVec2& corner, const ImVec2& size,
                        float scale) const {
  const ViewState& state = session.state();
  ImDrawList& list = *ImGui::GetWindowDrawList();
  glm::dvec3 cross(0.0);
  for (int axis = 0; axis < 3; ++axis)
    cross[axis] = state.slices[static_cast<std::size_t>(axis)].position;
  const glm::dvec2 at = frame.pixelOf(cross);
  const float x = corner.x + static_cast<float>(at.x), y = corner.y + static_cast<float>(at.y);
  const auto across = static_cast<std::size_t>(frame.right.x != 0.0   ? 0
                                               : frame.right.y != 0.0 ? 1
                                                                      : 2);
  const auto along = 3 - across - static_cast<std::size_t>(frame.axis);
  constexpr float kGap = 8.0f;  // the place itself stays visible
  for (const float side : {-1.0f, 1.0f}) {
    const float far = 1e5f * side;
    list.AddLine({x, y + side * kGap * scale}, {x, y + far}, kSliceColors[across], scale);
    list.AddLine({x + side * kGap * scale, y}, {x + far, y}, kSliceColors[along], scale);
  }
  const auto axis = static_cast<std::size_t>(frame.axis);
  const float margin = 8.0f * scale, line = ImGui::GetTextLineHeight();
  shadowed(list, {corner.x + margin, corner.y + margin}, kSliceColors[axis],
           text("across %s   %.0f of %.0f", kAxisNames[axis], state.slices[axis].position,
                static_cast<double>(session.volume().voxels[frame.axis] - 1)));
  constexpr ImU32 kPlain = IM_COL32(225, 225, 225, 255);
  const auto wide = [](const char* name) { return ImGui::CalcTextSize(name).x; };
  const float middle_x = corner.x + 0.5f * size.x, middle_y = corner.y + 0.5f * (size.y - line);
  shadowed(list, {corner.x + margin, middle_y}, kPlain, frame.sides[0]);
  shadowed(list, {corner.x + size.x - margin - wide(frame.sides[1]), middle_y}, kPlain,
           frame.sides[1]);
  shadowed(list, {middle_x, corner.y + margin}, kPlain, frame.sides[2]);
  shadowed(list, {middle_x, corner.y + size.y - margin - line}, kPlain, frame.sides[3]);
  if (shown == nullptr || !ImGui::IsItemHovered()) return;
  const ImVec2 mouse = ImGui::GetIO().MousePos;
  const glm::dvec2 pixel(static_cast<double>(mouse.x - corner.x),
                         static_cast<double>(mouse.y - corner.y));
  const std::optional<double> value = shown->valueAt(shown->frame.pixelOf(frame.indexAt(pixel)));
  if (!value) return;
  glm::dvec3 place = frame.indexAt(pixel);
  place[frame.axis] = cross[frame.axis];
  shadowed(
      list, {corner.x + margin, corner.y + size.y - margin - line}, kPlain,
      text("%.0f %.0f %.0f:  ", std::round(place.x), std::round(place.y), std::round(place.z)) +
          shortNumber(*value));
}

void SlicesPanel::build(ViewSession& session, float scale, const std::array<SceneArea, 3>& areas) {
  SliceViews& slices = session.sliceViews();
  if (!session.state().slice_views.shown) {
    slices.forget();
    return;
  }
  const ImVec2 window = ImGui::GetIO().DisplaySize;
  has_drawn_ = false;
  first_ = (first_ + 1) % kSliceViews;
  for (int turn = 0; turn < kSliceViews; ++turn) {
    const int view = (first_ + turn) % kSliceViews;
    const SceneArea& area = areas[static_cast<std::size_t>(view)];
    if (area.width < 2 || area.height < 2) continue;
    const ImVec2 size{static_cast<float>(area.width), static_cast<float>(area.height)};
    const ImVec2 corner{static_cast<float>(area.left),
                        window.y - static_cast<float>(area.bottom + area.height)};
    ImGui::SetNextWindowPos(corner);
    ImGui::SetNextWindowSize(size);
    ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
    ImGui::PushStyleVar(ImGuiStyleVar_WindowBorderSize, 0.0f);
    ImGui::PushStyleVar(ImGuiStyleVar_WindowRounding, 0.0f);
    ImGui::PushStyleVar(ImGuiStyleVar_WindowMinSize, {1.0f, 1.0f});
    ImGui::PushStyleColor(ImGuiCol_WindowBg, IM_COL32(18, 18, 18, 255));
    if (ImGui::Begin(text("slice %d", view).c_str(), nullptr,
                     ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                         ImGuiWindowFlags_NoNav | ImGuiWindowFlags_NoScrollWithMouse |
                         ImGuiWindowFlags_NoBringToFrontOnFocus)) {
      const SliceFrame frame =
          sliceFrame(session.state(), session.volume(), view, {area.width, area.height});
      slices.want(view, frame, area.width, area.height);
      ImGui::InvisibleButton("view", size,
                             ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                                 ImGuiButtonFlags_MouseButtonMiddle);
      const auto& shown = slices.shown(view);
      if (shown) {
        const auto place = [&](int x, int y) {
          const glm::dvec2 at =
              frame.pixelOf(shown->frame.indexAt(shown->pixels * glm::dvec2(x, y)));
          return ImVec2{corner.x + static_cast<float>(at.x), corner.y + static_cast<float>(at.y)};
        };
        ImGui::GetWindowDrawList()->AddImage(pictureOf(view, *shown, session.state(), scale).id(),
                                             place(0, 0),
                                             place(shown->values.width, shown->values.height));
      }
      notes(session, frame, shown ? &*shown : nullptr, corner, size, scale);
      input(session, frame, corner);
    }
    ImGui::End();
    ImGui::PopStyleColor();
    ImGui::PopStyleVar(4);
  }
}

}  // namespace isobrick
