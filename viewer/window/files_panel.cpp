#include <imgui.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/window/panel_tools.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// A line to choose, shown literally: ImGui takes "##" in a label for a mark of its own.
bool chooses(int id, const std::string& shown, bool is_marked = false) {
  ImGui::PushID(id);
  const bool chosen = ImGui::Selectable("##line", is_marked);
  ImGui::SameLine(0.0f, 0.0f);
  ImGui::TextUnformatted(shown.c_str(), shown.c_str() + shown.size());
  ImGui::PopID();
  return chosen;
}

// A window in the middle of the screen, at most as large as that.
void placeInMiddle(double scale, float width, float height) {
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  const auto pixels = static_cast<float>(scale);
  ImGui::SetNextWindowPos({0.5f * screen.x, 0.5f * screen.y}, ImGuiCond_Appearing, {0.5f, 0.5f});
  ImGui::SetNextWindowSize(
      {std::min(pixels * width, screen.x), std::min(pixels * height, screen.y)},
      ImGuiCond_Appearing);
  ImGui::SetNextWindowBgAlpha(0.96f);
}

}  // namespace

OpenPanel::OpenPanel()
    : lister_([](const std::string& folder, const CancelFlag& cancel) {
        return listFolder(folder, cancel);
      }) {}

void OpenPanel::goTo(const std::string& folder) {
  error_.clear();
  lister_.request(folder);
}

void OpenPanel::takeListing() {
  if (!listed_) goTo(".");
  listed_ = true;
  auto outcome = lister_.poll();
  if (!outcome) return;
  error_ = outcome->error;
  if (!outcome->result) return;
  listing_ = std::move(*outcome->result);
}

Wishes OpenPanel::entries(float width) {
  Wishes wishes;
  if (ImGui::SmallButton("up")) goTo(fs::path(listing_.folder).parent_path().string());
  ImGui::SameLine();
  // A folder of slices is a volume too.
  if (ImGui::SmallButton("open this folder")) wishes.open = listing_.folder;
  ImGui::SameLine();
  ImGui::TextUnformatted(shownName(listing_.folder).c_str());
  if (!error_.empty()) ImGui::TextColored(kErrorText, "%s", shownName(error_).c_str());
  if (ImGui::BeginChild("entries", {width, -2.0f * ImGui::GetFrameHeightWithSpacing()}, true)) {
    ImGuiListClipper clipper;
    clipper.Begin(static_cast<int>(listing_.entries.size()));
    while (clipper.Step()) {
      for (int i = clipper.DisplayStart; i < clipper.DisplayEnd; ++i) {
        const FolderEntry& entry = listing_.entries[static_cast<std::size_t>(i)];
        if (!chooses(i, shownName(entry.name) + (entry.is_folder ? "/" : ""))) continue;
        const std::string path = (fs::path(listing_.folder) / entry.name).string();
        if (entry.is_folder)
          goTo(path);
        else
          wishes.open = path;
      }
    }
    if (listing_.cut) ImGui::TextUnformatted("there are more: type the name below");
  }
  ImGui::EndChild();
  return wishes;
}

Wishes OpenPanel::build(double scale, const std::vector<std::string>& recent) {
  Wishes wishes;
  if (!visible) return wishes;
  takeListing();
  placeInMiddle(scale, 560.0f, 420.0f);
  if (ImGui::Begin("open a volume", &visible, ImGuiWindowFlags_NoCollapse)) {
    if (!recent.empty() && ImGui::CollapsingHeader("opened last", ImGuiTreeNodeFlags_DefaultOpen)) {
      for (std::size_t i = 0; i < recent.size(); ++i)
        if (chooses(-1 - static_cast<int>(i), shownName(recent[i]))) wishes.open = recent[i];
    }
    addWishes(entries(0.0f), wishes);
    std::array<char, 4096> text{};
    typed_.copy(text.data(), text.size() - 1);
    ImGui::SetNextItemWidth(-60.0f * static_cast<float>(scale));
    const bool entered =
        ImGui::InputTextWithHint("##path", "a path, or phantom:head:256", text.data(), text.size(),
                                 ImGuiInputTextFlags_EnterReturnsTrue);
    typed_ = text.data();
    ImGui::SameLine();
    if ((ImGui::Button("open") || entered) && !typed_.empty()) wishes.open = typed_;
  }
  ImGui::End();
  if (wishes.open) visible = false;
  return wishes;
}

Wishes ChoicePanel::build(const VolumeOpener::Status& opening, double scale) {
  Wishes wishes;
  const int count = static_cast<int>(opening.choices.size());
  if (count == 0) return wishes;
  placeInMiddle(scale, 560.0f, 240.0f);
  if (ImGui::Begin("several volumes: choose one (arrows and Enter, or a click)", nullptr,
                   ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoNav)) {
    // Keys that were pressed before it was shown choose nothing.
    const bool appears = ImGui::IsWindowAppearing();
    const auto hears = [&](ImGuiKey key) { return !appears && isPanelKeyPressed(key); };
    if (appears) at_ = 0;
    const int step = (hears(ImGuiKey_DownArrow) ? 1 : 0) - (hears(ImGuiKey_UpArrow) ? 1 : 0);
    at_ = std::clamp(at_ + step, 0, count - 1);
    for (int i = 0; i < count; ++i) {
      const std::string& line = opening.choices[static_cast<std::size_t>(i)];
      if (chooses(i, shownName(line), i == at_)) wishes.choose = static_cast<std::size_t>(i);
      if (i == at_ && step != 0) ImGui::SetScrollHereY();
    }
    if (hears(ImGuiKey_Enter)) wishes.choose = static_cast<std::size_t>(at_);
    wishes.stop_opening = hears(ImGuiKey_Escape);
  }
  ImGui::End();
  return wishes;
}

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
