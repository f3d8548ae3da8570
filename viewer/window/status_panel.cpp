#include <imgui.h>

#include <algorithm>
#include <array>
#include <cfloat>
#include <glm/vec3.hpp>

#include "isobrick/extract/color_map.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/window/panel_tools.h"
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

namespace {

std::string megabytes(std::uint64_t bytes) {
  return text("%.1f MiB", static_cast<double>(bytes) / (1 << 20));
}

// The volume that is being opened, or why the last one was not opened; the session's line stays
// beside it.
Wishes openingLine(const PanelFacts& facts) {
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
Wishes openingError(const PanelFacts& facts, float scale) {
  Wishes wishes;
  if (facts.open_error.empty()) return wishes;
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  const float width = std::max(1.0f, size.x);
  ImGui::SetNextWindowPos({0.0f, size.y - statusHeight(scale)}, ImGuiCond_Always, {0.0f, 1.0f});
  ImGui::SetNextWindowSizeConstraints({width, 0.0f}, {width, std::max(1.0f, size.y)});
  if (ImGui::Begin("why not", nullptr,
                   ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                       ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoNav)) {
    wishes.stop_opening = ImGui::SmallButton("x");
    ImGui::SameLine();
    ImGui::PushStyleColor(ImGuiCol_Text, kErrorText);
    ImGui::TextWrapped("%s", shownName(facts.open_error).c_str());
    ImGui::PopStyleColor();
  }
  ImGui::End();
  return wishes;
}

}  // namespace

void buildStatistics(const ViewSession& session, const PanelFacts& facts, float scale) {
  if (!ImGui::CollapsingHeader("statistics")) return;
  const SessionStatus status = session.status();
  ImGui::Text("%llu triangles, %s", static_cast<unsigned long long>(status.triangles),
              megabytes(status.shown_bytes).c_str());
  ImGui::Text("radius %.0f of %.0f voxels", status.shown_radius, status.wanted_radius);
  ImGui::Text("extracted in %.1f ms, %.1f Mtri/s", 1e3 * status.extract_seconds,
              1e-6 * status.triangles_per_second);
  ImGui::Text("radius while dragging %.0f", status.drag_radius);
  ImGui::Text("made by the pass: %llu triangles",
              static_cast<unsigned long long>(status.triangles_made));
  ImGui::Text("bricks read by the pass: %llu", static_cast<unsigned long long>(status.bricks_read));
  ImGui::Text("in memory %s of %s", megabytes(session.pyramid().parts().heldBytes()).c_str(),
              megabytes(session.pyramid().budgetBytes()).c_str());
  const BrickPager::Counters counters = session.pyramid().parts().counters();
  ImGui::Text("parts read %llu, evicted %llu", static_cast<unsigned long long>(counters.parts_read),
              static_cast<unsigned long long>(counters.parts_released));
  for (const LevelCounts& level : status.levels) {
    const double share =
        static_cast<double>(level.triangles) / std::max(1.0, static_cast<double>(status.triangles));
    // In the colour that the level has on the surface, dark enough for the text on it.
    const glm::vec3 color = kLevelBarShade * levelColor(level.level);
    ImGui::PushStyleColor(ImGuiCol_PlotHistogram, {color.r, color.g, color.b, 1.0f});
    ImGui::ProgressBar(
        static_cast<float>(share), {-1.0f, 0.0f},
        text("level %d: %llu", level.level, static_cast<unsigned long long>(level.triangles))
            .c_str());
    ImGui::PopStyleColor();
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
                     {ImGui::GetContentRegionAvail().x, 36.0f * scale});
  };
  plot("interface", interface);
  plot("drawing", drawing);
  ImGui::TextWrapped("%s", facts.device.c_str());
}

Wishes StatusPanel::build(ViewSession* session, const PanelFacts& facts, float scale, bool hovers) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.0f, size.y - statusHeight(scale)});
  ImGui::SetNextWindowSize({std::max(1.0f, size.x), statusHeight(scale)});
  Wishes wishes;
  if (ImGui::Begin(
          "status", nullptr,
          ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoNav)) {
    wishes = openingLine(facts);
    if (session != nullptr) {
      if (facts.opening.busy) {
        ImGui::TextUnformatted("|");
        ImGui::SameLine();
      }
      sessionLine(*session, facts, scale, hovers);
    } else if (!facts.opening.busy) {
      ImGui::TextUnformatted("N: open a volume, or drop one here");
    }
  }
  ImGui::End();
  addWishes(openingError(facts, scale), wishes);
  return wishes;
}

void StatusPanel::sessionLine(ViewSession& session, const PanelFacts& facts, float scale,
                              bool hovers) {
  const SessionStatus status = session.status();
  const std::string& failure = facts.failure.empty() ? status.error : facts.failure;
  if (!failure.empty()) {
    ImGui::TextColored(kErrorText, "%s", failure.c_str());
  } else {
    const Interaction& interaction = session.interaction();
    if (interaction.tool == Interaction::Tool::kPiece) {
      ImGui::TextColored(kWarningText, "%s",
                         session.pieces().busy() ? "pieces: looking for it |"
                         : session.pieces().selectedPiece() == nullptr
                             ? "pieces: click one on the surface; Esc ends |"
                             : "pieces: Enter keeps only this one, Delete hides it; Esc ends |");
      ImGui::SameLine();
    } else if (interaction.tool != Interaction::Tool::kNone) {
      const bool is_angle = interaction.tool == Interaction::Tool::kAngle;
      if (session.state().measurements.size() < kMostMeasurements)
        ImGui::TextColored(kWarningText, "%s: click point %zu of %d on the surface; Esc ends |",
                           is_angle ? "angle" : "distance", interaction.picked.size() + 1,
                           is_angle ? 3 : 2);
      else
        ImGui::TextColored(kWarningText, "a view has at most %zu measurements; remove one |",
                           kMostMeasurements);
      ImGui::SameLine();
    }
    ImGui::TextUnformatted(status.doing.c_str());
    if (!facts.writing.empty()) {
      ImGui::SameLine();
      ImGui::Text("| writing %s", facts.writing.c_str());
    }
    if (!status.limited.empty()) {
      ImGui::SameLine();
      ImGui::TextColored(kWarningText, "| %s", status.limited.c_str());
    }
    if (!facts.message.empty()) {
      ImGui::SameLine();
      ImGui::Text("| %s", facts.message.c_str());
    }
  }
  if (hovers) {
    hover_.clear();
    if (const auto point = session.surfaceUnderCursor()) {
      const glm::dvec3 voxel = session.volume().geometry.worldToIndex(*point);
      hover_ = text("voxel %.1f %.1f %.1f   world %.1f %.1f %.1f", voxel.x, voxel.y, voxel.z,
                    point->x, point->y, point->z);
    }
  }
  const std::string right = hover_.empty() ? "H: keys" : hover_;
  const float end = ImGui::GetItemRectMax().x, margin = 12.0f * scale;
  const float at = ImGui::GetIO().DisplaySize.x - ImGui::CalcTextSize(right.c_str()).x - margin;
  if (at < end + margin) return;  // the left part needs the room
  ImGui::SameLine(at);
  ImGui::TextUnformatted(right.c_str());
}

}  // namespace isobrick
