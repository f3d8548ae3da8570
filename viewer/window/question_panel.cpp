#include <imgui.h>

#include "isobrick/viewer/window/panel_keys.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {

Wishes buildQuestion(const std::optional<UserQuestion>& question) {
  Wishes wishes;
  if (!question) return wishes;
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5f * screen.x, 0.4f * screen.y}, ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::SetNextWindowFocus();
  if (ImGui::Begin("question", nullptr,
                   ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoMove |
                       ImGuiWindowFlags_NoResize | ImGuiWindowFlags_AlwaysAutoResize)) {
    ImGui::PushTextWrapPos(0.8f * screen.x);
    ImGui::TextUnformatted(question->text.c_str());
    ImGui::PopTextWrapPos();
    // Keys that were pressed before it was shown are no answer.
    const bool listens = !ImGui::IsWindowAppearing();
    const auto hears = [&](ImGuiKey key) { return listens && isPanelKeyPressed(key); };
    if (ImGui::Button(question->yes) || hears(ImGuiKey_Enter)) wishes.answer = true;
    ImGui::SameLine();
    if (ImGui::Button(question->no) || hears(ImGuiKey_Escape)) wishes.answer = false;
  }
  ImGui::End();
  return wishes;
}

}  // namespace isobrick
