#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/window/panel_style.h"
#include "isobrick/viewer/window/panel_tools.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {

const PanelTexture& ViewsPanel::textureOf(const NamedView& view) {
  PanelTexture& texture = textures_[view.number];
  if (texture.isEmpty()) texture.set(view.thumbnail);
  return texture;
}

// One view: its picture and name, which show it, and a button that removes it after a question.
Wishes ViewsPanel::line(const NamedView& view, float scale) {
  Wishes wishes;
  const float height = 48.0f * scale;
  const float width = 1.5f * height;
  const ImVec2 begin = ImGui::GetCursorPos();
  if (ImGui::Selectable("##show", false, 0, {0.0f, height})) wishes.show_named_view = view.name;
  ImGui::SetItemAllowOverlap();
  explain("Shows this view. Ctrl+Z goes back.");
  const ImVec2 end = ImGui::GetCursorPos();
  ImGui::SetCursorPos(begin);
  if (view.thumbnail.width > 0) {
    const float shrink = std::min(width / static_cast<float>(view.thumbnail.width),
                                  height / static_cast<float>(view.thumbnail.height));
    ImGui::Image(textureOf(view).id(), {shrink * static_cast<float>(view.thumbnail.width),
                                        shrink * static_cast<float>(view.thumbnail.height)});
  }
  ImGui::SetCursorPos(
      {begin.x + width + 8.0f * scale, begin.y + 0.5f * (height - ImGui::GetFrameHeight())});
  ImGui::AlignTextToFramePadding();
  if (removing_ == view.name) {
    ImGui::TextUnformatted("remove it?");
    ImGui::SameLine();
    if (ImGui::Button("yes")) wishes.remove_named_view = view.name;
    ImGui::SameLine();
    if (ImGui::Button("no") || wishes.remove_named_view) removing_.clear();
  } else {
    const std::string name = shownName(view.name);
    ImGui::TextUnformatted(name.c_str(), name.c_str() + name.size());
    ImGui::SameLine(std::max(0.0f, ImGui::GetContentRegionMax().x - ImGui::GetFrameHeight()));
    if (ImGui::Button("x")) removing_ = view.name;
    explain("Removes this view and its files.");
  }
  ImGui::SetCursorPos(end);
  return wishes;
}

Wishes ViewsPanel::build(const NamedViews& views, float scale) {
  Wishes wishes;
  std::erase_if(textures_, [&](const auto& entry) {
    return std::none_of(views.views().begin(), views.views().end(),
                        [&](const NamedView& view) { return view.number == entry.first; });
  });
  if (!ImGui::CollapsingHeader("views")) return wishes;
  for (const NamedView& view : views.views()) {
    ImGui::PushID(static_cast<int>(view.number));
    addWishes(line(view, scale), wishes);
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
