#include <imgui.h>

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>

#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {

void cutControls(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("clip planes", ImGuiTreeNodeFlags_DefaultOpen)) return;
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
    explain("Cuts, or not.");
    ImGui::SameLine();
    ImGui::SetNextItemWidth(80.0f * scale);
    sliderOf("##offset", plane.offset, least, most, "%.1f");
    explain("Its place along its normal, in world units. In the scene, drag the square.");
    ImGui::SameLine();
    ImGui::Checkbox("cap", &plane.cap);
    explain("Shows the volume's values on the cut, inside the surface.");
    ImGui::SameLine();
    if (ImGui::Button("flip")) {
      plane.normal = -plane.normal;
      plane.offset = -plane.offset;
    }
    explain("Keeps the other side. I flips the last plane.");
    ImGui::SameLine();
    if (ImGui::Button("x")) removed = i;
    explain("Removes this plane.");
    ImGui::SetNextItemWidth(200.0f * scale);
    std::array<float, 3> normal{static_cast<float>(plane.normal.x),
                                static_cast<float>(plane.normal.y),
                                static_cast<float>(plane.normal.z)};
    if (ImGui::DragFloat3("normal", normal.data(), 0.01f, -1.0f, 1.0f, "%.2f")) {
      const glm::dvec3 wanted(normal[0], normal[1], normal[2]);
      if (glm::length(wanted) > 1e-3) plane.normal = glm::normalize(wanted);
    }
    explain("The direction of what stays, in the world's axes.");
    ImGui::PopID();
  }
  if (removed)
    state.clip_planes.erase(state.clip_planes.begin() + static_cast<std::ptrdiff_t>(*removed));
  if (state.clip_planes.size() == kMostClipPlanes) return;
  ImGui::AlignTextToFramePadding();
  ImGui::TextDisabled("add a plane across");
  for (const char* axis : {"x", "y", "z"}) {
    ImGui::SameLine();
    const bool is_wanted = ImGui::Button(axis);
    explain("Through the focus. The keys X, Y and Z turn it on and off.");
    if (is_wanted) return addClipPlane(*axis - 'x', session.volume(), state);
  }
}

}  // namespace isobrick
