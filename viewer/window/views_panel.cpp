#include <imgui.h>

#include <algorithm>

#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/window/panel_style.h"
#include "isobrick/viewer/window/panel_tools.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {

// One view: its name, which shows it, and a button that removes it after a question.
Wishes ViewsPanel::line(const std::string& view) {
  Wishes wishes;
  const float line = ImGui::GetFrameHeight();
  const ImVec2 begin = ImGui::GetCursorPos();
  if (ImGui::Selectable("##show", false, 0, {0.0f, line})) wishes.show_named_view = view;
  ImGui::SetItemAllowOverlap();
  explain("Shows this view. Ctrl+Z goes back.");
  const ImVec2 end = ImGui::GetCursorPos();
  ImGui::SetCursorPos(begin);
  ImGui::AlignTextToFramePadding();
  if (removing_ == view) {
    ImGui::TextUnformatted("remove it?");
    ImGui::SameLine();
    if (ImGui::Button("yes")) wishes.remove_named_view = view;
    ImGui::SameLine();
    if (ImGui::Button("no") || wishes.remove_named_view) removing_.clear();
  } else {
    const std::string name = shownName(view);
    ImGui::TextUnformatted(name.c_str(), name.c_str() + name.size());
    ImGui::SameLine(std::max(0.0f, ImGui::GetContentRegionMax().x - line));
    if (ImGui::Button("x")) removing_ = view;
    explain("Removes this view and its file.");
  }
  ImGui::SetCursorPos(end);
  return wishes;
}

Wishes ViewsPanel::build(const NamedViews& views, float scale) {
  Wishes wishes;
  if (!ImGui::CollapsingHeader("views")) return wishes;
  for (const std::string& view : views.names()) {
    ImGui::PushID(view.c_str());
    addWishes(line(view), wishes);
    ImGui::PopID();
  }
  if (!views.error().empty())
    ImGui::TextColored(kErrorText, "%s", shownName(views.error()).c_str());
  const std::string free = views.freeName();
  ImGui::SetNextItemWidth(170.0f * scale);
  const bool entered = ImGui::InputTextWithHint(
      "##name", free.c_str(), typed_.data(), typed_.size(), ImGuiInputTextFlags_EnterReturnsTrue);
  explain("The name of a view to save.");
  ImGui::SameLine();
  const std::string name = typed_.front() != '\0' ? std::string(typed_.data()) : free;
  const bool pressed = ImGui::Button(views.has(name) ? "replace" : "save");
  explain("Keeps this view in a folder beside the volume (Ctrl+Shift+S without a name).");
  if (entered || pressed) {
    wishes.save_named_view = name;
    typed_.fill('\0');
  }
  return wishes;
}

}  // namespace isobrick
