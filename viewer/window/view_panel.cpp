#include "isobrick/viewer/window/view_panel.h"

#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

#include <algorithm>
#include <cstddef>
#include <new>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {

ViewPanel::ViewPanel(double scale, Clipboard& clipboard) : scale_(scale), clipboard_(clipboard) {
  // ImGui writes to what it gets without a look; a failure has to be thrown.
  ImGui::SetAllocatorFunctions([](std::size_t bytes, void*) { return ::operator new(bytes); },
                               [](void* memory, void*) { ::operator delete(memory); });
  ImGui::CreateContext();
  ImGuiIO& io = ImGui::GetIO();
  io.ClipboardUserData = this;
  io.SetClipboardTextFn = [](void* panel, const char* text) {
    static_cast<ViewPanel*>(panel)->clipboard_.setClipboardText(text);
  };
  io.GetClipboardTextFn = [](void* panel) {
    auto& self = *static_cast<ViewPanel*>(panel);
    self.pasted_ = self.clipboard_.clipboardText();
    return self.pasted_.c_str();
  };
  io.IniFilename = nullptr;  // nothing is left in the user's folder
  io.UserData = &still_seconds_;
  setPanelStyle(scale);
  setUpPanelKeys();
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

void ViewPanel::setScale(double scale) {
  if (scale == scale_) return;
  scale_ = scale;
  ImGui_ImplOpenGL3_DestroyFontsTexture();
  setPanelStyle(scale);
  ImGui_ImplOpenGL3_CreateFontsTexture();
}

void ViewPanel::feed(const InputEvent& event) {
  ImGuiIO& io = ImGui::GetIO();
  // Those of a key, until the panel has seen it.
  if (pressed_.empty() || event.kind == InputEvent::Kind::kKeyPress)
    setPanelModifiers(event.shift, event.control);
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
      io.MouseWheelH -= static_cast<float>(event.across);  // it counts to the left
      break;
    case InputEvent::Kind::kKeyPress:
      setPanelKey(event.key, true);
      pressed_.push_back(event.key);
      break;
    case InputEvent::Kind::kKeyRelease:
      if (std::find(pressed_.begin(), pressed_.end(), event.key) != pressed_.end())
        released_.push_back(event.key);
      else
        setPanelKey(event.key, false);
      break;
    case InputEvent::Kind::kText:
      io.AddInputCharacter(event.character);
      break;
    case InputEvent::Kind::kResize:
    case InputEvent::Kind::kClose:
    case InputEvent::Kind::kOpen:
    case InputEvent::Kind::kRefresh:
      break;
  }
}

void ViewPanel::begin(int width, int height, double seconds) {
  ImGuiIO& io = ImGui::GetIO();
  io.DisplaySize = {static_cast<float>(width), static_cast<float>(height)};
  io.DeltaTime = static_cast<float>(std::clamp(seconds, 1e-4, 1.0));
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::NewFrame();
  for (const Key key : released_) setPanelKey(key, false);
  pressed_.clear();
  released_.clear();
  const bool moves = io.MouseDelta.x != 0.0f || io.MouseDelta.y != 0.0f || ImGui::IsAnyMouseDown();
  still_seconds_ = moves ? 0.0 : still_seconds_ + seconds;
}

bool ViewPanel::wantsMouse() const { return ImGui::GetIO().WantCaptureMouse; }
bool ViewPanel::wants(const InputEvent& key) const {
  // Leaving once more is a yes.
  if (asks_) return key.key != Key::kQ || !key.control;
  // ImGui says so for one frame more than there is a field.
  return ImGui::GetIO().WantTextInput && ImGui::IsAnyItemActive();
}

void ViewPanel::draw() {
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

void ViewPanel::discard() { ImGui::EndFrame(); }

Wishes ViewPanel::panel(ViewSession& session, const PanelFacts& facts) {
  const auto scale = static_cast<float>(scale_);
  const ImVec2 window = ImGui::GetIO().DisplaySize;
  const auto width = static_cast<float>(panelWidth(static_cast<double>(window.x), scale_));
  ImGui::SetNextWindowPos({0.0f, 0.0f});
  ImGui::SetNextWindowSize({width, std::max(1.0f, window.y - statusHeight(scale))});
  Wishes wishes;
  if (ImGui::Begin("panel", nullptr,
                   ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize |
                       ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoTitleBar |
                       ImGuiWindowFlags_HorizontalScrollbar | ImGuiWindowFlags_NoNav |
                       ImGuiWindowFlags_NoBringToFrontOnFocus)) {
    ImGui::PushItemWidth(0.52f * width);
    timeControls(session, facts.steps);
    wishes = buildControls(session, scale);
    ImGui::PushID("views");
    addWishes(views_panel_.build(facts.views, scale), wishes);
    ImGui::PopID();
    buildStatistics(session, facts, scale);
    ImGui::PopItemWidth();
  }
  ImGui::End();
  return wishes;
}

Wishes ViewPanel::build(ViewSession* session, const PanelFacts& facts, const WindowAreas& areas) {
  Wishes wishes;
  const auto scale = static_cast<float>(scale_);
  const bool hovers = !wantsMouse();
  if (session != nullptr) slices_panel_.build(*session, scale, areas.slices);
  if (session != nullptr && session->interaction().show_panel) wishes = panel(*session, facts);
  addWishes(status_.build(session, facts, scale, hovers), wishes);
  addWishes(open_panel_.build(scale_, facts.recent), wishes);
  addWishes(choice_panel_.build(facts.opening, scale_), wishes);
  addWishes(buildQuestion(facts.question), wishes);
  asks_ = facts.question || !facts.opening.choices.empty();
  if (session != nullptr) buildOverlay(*session, scale, hovers, areas.scene);
  return wishes;
}

}  // namespace isobrick
